"""What is handed over can be used as it stands."""

import json
import math
import subprocess
import sys
from dataclasses import replace
from pathlib import Path

import pycolmap
import pytest

from gtf_tune.errors import StorageError
from gtf_tune.metrics import ate
from gtf_tune.pipelines import create_pipeline
from gtf_tune.sequence import Sequence
from gtf_tune.study.tune.handover import Configurations, Handover, check_output, hand_over, write_scripts
from gtf_tune.trajectory import read_trajectory
from tests.pipelines.conftest import make_scene

FIXED = {"mapper.bundle_adjustment.refine_focal_length": False, "mapper.bundle_adjustment.refine_extra_params": False}
ADOPTED = {**FIXED, "mapper.bundle_adjustment.ceres.loss_function_scale": 0.2}


@pytest.fixture(scope="module")
def scene(tmp_path_factory: pytest.TempPathFactory) -> Sequence:
    return make_scene(tmp_path_factory.mktemp("scene"), frames=8)


@pytest.fixture(scope="module")
def handover(scene: Sequence, tmp_path_factory: pytest.TempPathFactory) -> Handover:
    folder = tmp_path_factory.mktemp("here") / "scene-tuned"
    return hand_over(folder, scene, create_pipeline("glomap"), Configurations(ADOPTED, FIXED), check=True)


@pytest.fixture
def folder(handover: Handover) -> Path:
    return handover.folder


def test_both_models_and_everything_that_makes_them_are_there(folder: Path) -> None:
    assert {path.name for path in folder.iterdir()} >= {
        "sparse",
        "sparse-nominal",
        "run.py",
        "run.sh",
        "options.json",
        "options-nominal.json",
        "images.txt",
        "trajectory.txt",
        "transforms.json",
    }
    models = [pycolmap.Reconstruction(folder / name / "0") for name in ("sparse", "sparse-nominal")]
    assert [model.num_reg_images() for model in models] == [8, 8]
    assert json.loads((folder / "options.json").read_text())["mapper"]["bundle_adjustment"]["ceres"] == {
        "loss_function_scale": 0.2
    }


def test_the_trajectory_is_that_of_the_model_and_near_the_truth(handover: Handover, scene: Sequence) -> None:
    written = read_trajectory(handover.folder / "trajectory.txt")

    assert scene.ground_truth is not None
    assert written.timestamps.tolist() == scene.ground_truth.timestamps.tolist()
    assert ate(scene.ground_truth, handover.adopted.trajectory) < 0.02


def test_the_script_makes_the_same_model_again(folder: Path, tmp_path: Path) -> None:
    subprocess.run([sys.executable, folder / "run.py", tmp_path / "again"], check=True, capture_output=True)

    first, second = (pycolmap.Reconstruction(one / "0") for one in (folder / "sparse", tmp_path / "again"))
    centres = [
        {image.name: image.projection_center().tolist() for image in model.images.values()} for model in (first, second)
    ]
    assert centres[0] == centres[1]


def test_refined_intrinsics_are_tried_and_only_a_larger_movement_than_under_noise_is_said(handover: Handover) -> None:
    assert 0 < handover.moved_by_calibration < 0.05
    limited = replace(handover, moved_by_calibration=0.005)

    assert "the trajectory moves by 5 per mille of its extent, under noise by 2;" in limited.calibration_limit(0.002)
    assert limited.calibration_limit(0.006) == ""
    assert replace(handover, moved_by_calibration=math.nan).calibration_limit(0.0) == ""


def test_scripts_alone_are_those_of_the_whole_handover(folder: Path, scene: Sequence, tmp_path: Path) -> None:
    write_scripts(tmp_path / "scripts", scene, create_pipeline("glomap"), Configurations(ADOPTED, FIXED))

    written = {path.name: path.read_text() for path in (tmp_path / "scripts").iterdir()}
    assert set(written) >= {"run.py", "run.sh", "options.json", "options-nominal.json", "images.txt"}
    assert all((folder / name).read_text() == text for name, text in written.items())


def test_nothing_that_only_served_the_making_is_left(folder: Path) -> None:
    assert not [path.name for path in folder.iterdir() if path.suffix in (".db", ".log") or "refined" in path.name]


def test_a_folder_that_was_handed_over_is_replaced_and_any_other_is_refused(folder: Path, tmp_path: Path) -> None:
    check_output(folder)
    check_output(tmp_path / "new")
    check_output(tmp_path)
    (tmp_path / "thesis.tex").write_text("precious")

    with pytest.raises(StorageError, match="holds something else; choose another output folder or remove it"):
        check_output(tmp_path)
