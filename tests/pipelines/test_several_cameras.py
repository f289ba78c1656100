"""Sequences of several cameras: keys, databases, trajectories, scripts, and pipelines that take one camera."""

import json
import sys
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pycolmap
import pytest

from gtf_tune.errors import SequenceError
from gtf_tune.metrics import ate
from gtf_tune.pipelines import create_pipeline, with_focal_prior
from gtf_tune.pipelines.colmap.models import transforms_json
from gtf_tune.pipelines.colmap.script import Photographs, pycolmap_script
from gtf_tune.pipelines.colmap.shell import colmap_shell_script
from gtf_tune.pipelines.command.inputs import prepare
from gtf_tune.pipelines.command.resolution import resolve
from gtf_tune.pipelines.run import RunRequest
from gtf_tune.sequence import Camera, Sequence
from gtf_tune.testing import ContractCase, FolderStages
from gtf_tune.trajectory import Trajectory
from tests.pipelines.conftest import make_scene

GLOMAP = create_pipeline("glomap")
WIDE = Camera("PINHOLE", 64, 48, (50.0, 51.0, 32.0, 24.0))
UPRIGHT = Camera("SIMPLE_RADIAL", 48, 64, (50.0, 24.0, 32.0, 0.1))
BOTH = Photographs(Path("/photos"), ["a.jpg", "b.jpg", "c.jpg"], (WIDE, UPRIGHT), (0, 1, 0))


def _trajectory(sequence: Sequence, folder: Path, stages: FolderStages) -> Trajectory:
    options = {"mapper.bundle_adjustment.refine_focal_length": False, "mapper.skip_retriangulation": True}
    return ContractCase(GLOMAP, sequence, options).run(folder, stages).trajectory


def _extent(trajectory: Trajectory) -> float:
    return float(np.sqrt(trajectory.positions.var(axis=0).sum()))


def test_two_turned_images_give_the_trajectory_of_the_unturned_set(
    scene: Sequence, kept_stages: FolderStages, tmp_path: Path
) -> None:
    turned = make_scene(tmp_path, 9, turned=(2, 5))
    assert [camera.size for camera in turned.cameras] == [(240, 180), (180, 240)]

    expected = _trajectory(scene, tmp_path / "plain", kept_stages)
    found = _trajectory(turned, tmp_path / "turned", FolderStages(tmp_path / "stages"))

    assert len(found) == len(expected) == 9
    assert ate(expected, found) / _extent(expected) < 2e-3


def test_two_focal_lengths_are_two_cameras_of_the_database_and_give_the_true_trajectory(tmp_path: Path) -> None:
    zoomed = make_scene(tmp_path, 9, focals={1: 280.0, 4: 280.0, 7: 280.0})
    stages = FolderStages(tmp_path / "stages")

    found = _trajectory(zoomed, tmp_path / "run", stages)

    assert zoomed.ground_truth is not None
    assert len(found) == 9
    assert ate(zoomed.ground_truth, found) / _extent(zoomed.ground_truth) < 5e-3
    [database] = (tmp_path / "stages").glob("**/features*/**/database.db")
    (tmp_path / "copy.db").write_bytes(database.read_bytes())
    with pycolmap.Database.open(tmp_path / "copy.db") as opened:
        focals = {camera.camera_id: camera.params[0] for camera in opened.read_all_cameras()}
        of_images = {image.name: focals[image.camera_id] for image in opened.read_all_images()}
    assert sorted(focals.values()) == [220.0, 280.0]
    assert [name for name, focal in sorted(of_images.items()) if focal == 280.0] == [
        f"{3 * index:06d}.pgm" for index in (1, 4, 7)
    ]


def test_the_key_of_a_run_depends_on_who_took_what(tmp_path: Path) -> None:
    zoomed = make_scene(tmp_path, 4, focals={1: 280.0})
    frames = (replace(zoomed.frames[0], camera=1), *zoomed.frames[1:])

    def key(sequence: Sequence) -> str:
        return RunRequest(GLOMAP, {}, sequence, "clean", 0, 0.0, 0, 1).key

    exchanged, reversed_ = replace(zoomed, frames=frames), replace(zoomed, cameras=zoomed.cameras[::-1])
    assert len({key(zoomed), key(exchanged), key(reversed_)}) == 3
    assert zoomed.fingerprint == exchanged.fingerprint


def test_a_pipeline_of_one_camera_offers_the_largest_group(tmp_path: Path) -> None:
    zoomed = make_scene(tmp_path, 5, focals={1: 280.0})
    one: Any = SimpleNamespace(name="slam")

    with pytest.raises(SequenceError, match=r"takes the images of one camera, .* come from 2; use only the 4 images"):
        with_focal_prior(zoomed, one)
    assert with_focal_prior(zoomed.of_camera(0), one).frames == tuple(
        frame for frame in zoomed.frames if frame.camera == 0
    )


def test_a_step_for_each_camera_is_given_its_images_and_intrinsics(tmp_path: Path) -> None:
    turned = make_scene(tmp_path, 4, turned=(1,))
    step = {"name": "features", "arguments": [sys.executable], "each_camera": ["{camera_image_list}"]}
    pipeline = create_pipeline("command", {"steps": [step]})
    job = ContractCase(pipeline, turned).job(tmp_path / "run", FolderStages(tmp_path / "stages"), {})

    first, second = prepare(resolve({"steps": [step]}), job).cameras

    assert with_focal_prior(turned, pipeline) is turned
    assert Path(str(first["camera_image_list"])).read_text().split() == ["000000.pgm", "000006.pgm", "000009.pgm"]
    assert Path(str(second["camera_image_list"])).read_text().split() == ["000003.pgm"]
    assert (second["camera_model"], second["camera_params"]) == ("PINHOLE", "220.0,220.0,90.0,120.0")


def test_the_scripts_give_each_camera_its_images_and_intrinsics() -> None:
    script = pycolmap_script("glomap", BOTH, {}, "4.2.1")
    shell = colmap_shell_script("glomap", BOTH, {}, {}).replace("\\\n    ", "")

    assert '("images-1.txt", "PINHOLE", "50.0,51.0,32.0,24.0")' in script
    assert '("images-2.txt", "SIMPLE_RADIAL", "50.0,24.0,32.0,0.1")' in script
    assert {file: names for file, (_, names) in BOTH.lists.items()} == {
        "images-1.txt": ["a.jpg", "c.jpg"],
        "images-2.txt": ["b.jpg"],
    }
    extraction = [line for line in shell.splitlines() if line.startswith("colmap feature_extractor")]
    assert len(extraction) == 2
    assert (
        "--image_list_path images-2.txt --ImageReader.single_camera 1 --ImageReader.camera_model SIMPLE_RADIAL"
        in (extraction[1])
    )
    assert shell.count("view_graph_calibrator") == 0
    unknown = replace(BOTH, cameras=(WIDE, None))
    assert "view_graph_calibrator" in colmap_shell_script("glomap", unknown, {}, {})
    assert "calibrate_view_graph(database" in pycolmap_script("glomap", unknown, {}, "4.2.1")


def test_each_frame_of_transforms_json_has_the_intrinsics_of_its_camera(tmp_path: Path) -> None:
    options = pycolmap.SyntheticDatasetOptions()
    options.num_rigs, options.num_cameras_per_rig, options.num_frames_per_rig, options.num_points3D = 2, 1, 2, 10
    model = pycolmap.synthesize_dataset(options)
    for number, camera in enumerate(model.cameras.values()):
        camera.focal_length = 700.0 + number
    model.write(tmp_path)

    found = json.loads(transforms_json(tmp_path, Path("/photos")))

    expected = {image.name: model.cameras[image.camera_id].focal_length for image in model.images.values()}
    assert {frame["file_path"].removeprefix("/photos/"): frame["fl_x"] for frame in found["frames"]} == expected
    assert set(found) == {"camera_model", "frames"}
    assert set(expected.values()) == {700.0, 701.0}
