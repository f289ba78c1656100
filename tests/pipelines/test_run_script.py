"""The script that a user gets reconstructs as the pipeline does."""

import json
import subprocess
import sys
from collections.abc import Mapping
from pathlib import Path

import numpy as np
import pycolmap
import pytest

from gtf_tune.metrics import ate
from gtf_tune.pipelines import OptionValue, create_pipeline
from gtf_tune.pipelines.colmap.script import Photographs, pycolmap_script
from gtf_tune.sequence import Sequence
from gtf_tune.study.outcome.export import option_json
from gtf_tune.testing import ContractCase, FolderStages
from gtf_tune.trajectory import Trajectory

GLOMAP = {"mapper.max_normalized_reproj_error": 0.004, "mapper.bundle_adjustment.refine_focal_length": False}
COLMAP = {"pipeline.ba_refine_focal_length": False, "pipeline.min_model_size": 3, "mapper.filter_max_reproj_error": 2.0}


def reconstruct(folder: Path, scene: Sequence, pipeline: str, options: Mapping[str, OptionValue]) -> Trajectory:
    """Write the script for a scene, run it, and return the camera centres of the model that it leaves."""
    photographs = Photographs(scene.root, [frame.path.name for frame in scene.frames], (scene.camera,))
    (folder / "run.py").write_text(pycolmap_script(pipeline, photographs, {}, pycolmap.__version__, seed=7))
    (folder / "images.txt").write_text("\n".join(photographs.names) + "\n")
    (folder / "options.json").write_text(option_json(options))
    subprocess.run([sys.executable, folder / "run.py"], check=True, capture_output=True, cwd=folder)
    model = pycolmap.Reconstruction(folder / "sparse" / "0")
    poses = {image.name: image.cam_from_world().inverse() for image in model.images.values()}
    frames = [frame for frame in scene.frames if frame.path.name in poses]
    return Trajectory(
        frame_ids=np.array([frame.frame_id for frame in frames]),
        timestamps=np.array([frame.timestamp for frame in frames]),
        positions=np.array([poses[frame.path.name].translation for frame in frames]),
        quaternions=np.array([poses[frame.path.name].rotation.quat for frame in frames]),
    )


@pytest.mark.parametrize(("name", "options"), [("glomap", GLOMAP), ("colmap", COLMAP)])
def test_the_script_finds_the_poses_of_the_pipeline(
    scene: Sequence, tmp_path: Path, name: str, options: Mapping[str, OptionValue]
) -> None:
    (tmp_path / "run").mkdir()
    case = ContractCase(create_pipeline(name), scene, options)
    expected = case.run(tmp_path / "run", FolderStages(tmp_path / "stages")).trajectory

    found = reconstruct(tmp_path, scene, name, options)

    assert len(found) == len(expected) == len(scene)
    extent = float(np.sqrt(np.mean(np.sum((expected.positions - expected.positions.mean(axis=0)) ** 2, axis=1))))
    assert ate(expected, found) / extent < 1e-6


def test_the_model_has_the_colours_and_names_of_the_images(scene: Sequence, tmp_path: Path) -> None:
    reconstruct(tmp_path, scene, "glomap", GLOMAP)

    model = pycolmap.Reconstruction(tmp_path / "sparse" / "0")
    assert {image.name for image in model.images.values()} == {frame.path.name for frame in scene.frames}
    assert np.ptp([point.color for point in model.points3D.values()]) > 50


def test_unknown_intrinsics_are_calibrated_before_global_mapping(scene: Sequence) -> None:
    unknown = Photographs(scene.root, ["000.png"], (None,))

    script = pycolmap_script("glomap", unknown, {"camera_model": "RADIAL"}, "4.2.1")

    assert "calibrate_view_graph(database" in script
    assert '("images.txt", "RADIAL", "")' in script
    assert "calibrate_view_graph(database" not in pycolmap_script("colmap", unknown, {}, "4.2.1")


def test_names_with_quotes_and_backslashes_stay_what_they_are(scene: Sequence) -> None:
    folder = Path('/photos/it\'s "here"\\now')

    script = pycolmap_script("glomap", Photographs(folder, [], (scene.camera,)), {}, "4.2.1")

    assigned = next(line for line in script.splitlines() if line.startswith("IMAGES"))
    assert eval(assigned.removeprefix("IMAGES = "), {"Path": Path}) == folder


def test_sequential_matching_with_a_vocabulary_tree_is_in_the_script(scene: Sequence) -> None:
    settings = {"pairing": "sequential", "vocab_tree_path": "/trees/tree.bin"}

    script = pycolmap_script("glomap", Photographs(scene.root, [], (scene.camera,)), settings, "4.2.1")

    assert "pycolmap.match_sequential(" in script
    assert 'pairing.vocab_tree_path = "/trees/tree.bin"' in script
    assert json.dumps("SequentialPairingOptions") in script
