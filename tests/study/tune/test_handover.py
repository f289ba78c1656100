"""What is handed over can be used as it stands."""

import json
import math
import shutil
import subprocess
import sys
from dataclasses import replace
from pathlib import Path

import pycolmap
import pytest

from gtf_tune.errors import StorageError
from gtf_tune.metrics import ate
from gtf_tune.pipelines import create_pipeline
from gtf_tune.sequence import Sequence, SequenceCamera
from gtf_tune.study.tune.handover import Configurations, Handover, check_output, hand_over, write_scripts
from gtf_tune.study.tune.reconstruct import TooSlow, Workshop, _matches_file
from gtf_tune.trajectory import read_trajectory
from tests.pipelines.conftest import make_scene

FIXED = {"mapper.bundle_adjustment.refine_focal_length": False, "mapper.bundle_adjustment.refine_extra_params": False}
ADOPTED = {
    **FIXED,
    "verification.min_num_inliers": 20,
    "mapper.bundle_adjustment.ceres.loss_function_scale": 0.2,
}


@pytest.fixture(scope="module")
def scene(tmp_path_factory: pytest.TempPathFactory) -> Sequence:
    """Return images of two cameras: two of them are upright."""
    return make_scene(tmp_path_factory.mktemp("scene"), frames=8, turned=(2, 5))


@pytest.fixture(scope="module")
def handover(scene: Sequence, tmp_path_factory: pytest.TempPathFactory) -> Handover:
    """Hand nominal over and then what was adopted, as `gtf-tune tune` does."""
    folder = tmp_path_factory.mktemp("here") / "scene-tuned"
    workshop = Workshop(scene, create_pipeline("glomap"))
    hand_over(folder, workshop, Configurations(FIXED, FIXED, label="NOMINAL so far"), is_last=False)
    shutil.copytree(folder, folder.with_name("before"))
    assert (folder / "README.txt").read_text().startswith("sparse/0, options.json, run.sh,")
    assert "NOMINAL so far" in (folder / "run.sh").read_text()
    assert (folder / "sparse" / "0" / "points3D.bin").is_file()
    configurations = Configurations(ADOPTED, FIXED, label="ADOPTED options")
    return hand_over(folder, workshop, configurations, check_until=math.inf)


@pytest.fixture
def folder(handover: Handover) -> Path:
    return handover.folder


def test_features_and_matches_at_hand_serve_another_verification_too(folder: Path) -> None:
    (known,) = folder.with_name("before").glob("matches-*.db")

    file = _matches_file(folder.with_name("before"), ADOPTED)

    assert file != known == _matches_file(folder.with_name("before"), FIXED)
    with pycolmap.Database.open(known) as before, pycolmap.Database.open(file) as after:
        assert after.num_matches() == before.num_matches() > 0
        assert after.num_verified_image_pairs() == 0 < before.num_verified_image_pairs()


def test_both_models_and_everything_that_makes_them_are_there(folder: Path) -> None:
    assert {path.name for path in folder.iterdir()} >= {
        "sparse",
        "sparse-nominal",
        "run.py",
        "run.sh",
        "options.json",
        "options-nominal.json",
        "images-1.txt",
        "images-2.txt",
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
    assert set(written) >= {"run.py", "run.sh", "options.json", "options-nominal.json", "images-1.txt", "images-2.txt"}
    same = set(written) - {"README.txt", "run.sh", ".gtf-tune.json"}  # which say what the options are
    assert all((folder / name).read_text() == written[name] for name in same)


def test_what_is_not_confirmed_is_never_where_the_adopted_model_is(scene: Sequence, tmp_path: Path) -> None:
    workshop, said = Workshop(scene, create_pipeline("glomap")), list[str]()
    workshop.announce = said.append
    nominal = Configurations(FIXED, FIXED, label="NOMINAL options. Trial 3 is the best so far; not confirmed yet")

    for configurations in (nominal, replace(nominal, unconfirmed=ADOPTED)):
        hand_over(tmp_path / "out", workshop, configurations, is_last=False)

    out = tmp_path / "out"
    assert [text.partition(" images with the ")[2] for text in said] == ["nominal options", "options of the best trial"]
    poses = {name: _bytes(out / name) for name in ("sparse", "sparse-nominal", "sparse-unconfirmed")}
    assert poses["sparse"] == poses["sparse-nominal"] != poses["sparse-unconfirmed"]
    assert (out / "options.json").read_text() == (out / "options-nominal.json").read_text()
    assert (out / "README.txt").read_text().splitlines()[:2] == [
        "sparse/0, options.json, run.sh, trajectory.txt, transforms.json: NOMINAL options. Trial 3 is the best so far; "
        "not confirmed yet",
        "sparse-unconfirmed/0, options-unconfirmed.json: best trial of the search, NOT CONFIRMED on fresh noise.",
    ]


def _bytes(model: Path) -> bytes:
    return (model / "0" / "points3D.bin").read_bytes()


def test_a_best_trial_that_cannot_reconstruct_leaves_nominal_and_says_so(scene: Sequence, tmp_path: Path) -> None:
    hopeless = {**FIXED, "extraction.sift.max_num_features": 2}

    done = hand_over(tmp_path / "out", Workshop(scene, create_pipeline("glomap")), Configurations(hopeless, FIXED))

    assert "NOMINAL options. The best trial is not handed over:" in done.label
    assert " ".join(done.label.split()) in (tmp_path / "out" / "README.txt").read_text()
    assert json.loads((tmp_path / "out" / "options.json").read_text())["mapper"].keys() == {"bundle_adjustment"}
    assert _bytes(tmp_path / "out" / "sparse") == _bytes(tmp_path / "out" / "sparse-nominal")


def test_a_reconstruction_ends_when_its_time_is_up(scene: Sequence, tmp_path: Path) -> None:
    workshop = Workshop(scene, create_pipeline("glomap"), timeout_s=0.1)

    with pytest.raises(TooSlow, match="longer than 0 s"):
        hand_over(tmp_path / "out", workshop, Configurations(FIXED, FIXED))

    assert list(tmp_path.iterdir()) == []


def test_the_models_hold_the_cameras_of_their_images(folder: Path) -> None:
    names = {number: (folder / f"images-{number}.txt").read_text().split() for number in (1, 2)}
    assert names[2] == ["002.png", "005.png"]
    for model in (pycolmap.Reconstruction(folder / name / "0") for name in ("sparse", "sparse-nominal")):
        sizes = {image.name: model.cameras[image.camera_id] for image in model.images.values()}
        assert {name for name, camera in sizes.items() if camera.width < camera.height} == set(names[2])
        assert len(model.cameras) == 2
    frames = json.loads((folder / "transforms.json").read_text())["frames"]
    assert {Path(frame["file_path"]).name for frame in frames if frame["w"] < frame["h"]} == set(names[2])


def _half(camera: SequenceCamera) -> SequenceCamera:
    return SequenceCamera(camera.width // 2, camera.height // 2, camera.stored_size)


def test_models_of_reduced_images_say_so(scene: Sequence, tmp_path: Path) -> None:
    small = replace(scene, cameras=tuple(_half(camera) for camera in scene.cameras))

    write_scripts(tmp_path / "out", small, create_pipeline("glomap"), Configurations(FIXED, FIXED))

    options = json.loads((tmp_path / "out" / "options.json").read_text())
    assert options["extraction"] == {"max_image_size": max(small.width, small.height)}
    assert f"reduced to {small.width}x{small.height} pixels" in (tmp_path / "out" / "README.txt").read_text()


def test_nothing_that_only_served_the_making_is_left(folder: Path) -> None:
    assert not [path.name for path in folder.iterdir() if path.suffix in (".db", ".log") or "refined" in path.name]


def test_a_folder_that_was_handed_over_is_replaced_and_any_other_is_refused(folder: Path, tmp_path: Path) -> None:
    check_output(folder)
    check_output(tmp_path / "new")
    check_output(tmp_path)
    (tmp_path / "thesis.tex").write_text("precious")

    with pytest.raises(StorageError, match="holds something else; choose another output folder or remove it"):
        check_output(tmp_path)
