"""Every layout, as a miniature that describes camera and poses: what must come out, and what a given camera spares."""

import os
from pathlib import Path

import numpy as np
import pytest

from gtf_tune.errors import SequenceError
from gtf_tune.sequence import Camera, load_sequence
from tests.sequence import miniatures
from tests.sequence.miniatures import CALIBRATIONS, COUNT, LAYOUTS

GIVEN = Camera("PINHOLE", 64, 48, (40, 40, 32, 24))
WITH_TRUTH = sorted(set(LAYOUTS) - {"folder"})
OWN_POSES = sorted(set(WITH_TRUTH) - {"colmap", "euroc", "icl-nuim", "nerf", "tartanair"})


@pytest.fixture
def miniature(tmp_path, request):
    root = tmp_path / "set"
    LAYOUTS[request.param](root)
    return request.param, root


@pytest.mark.parametrize("miniature", sorted(LAYOUTS), indirect=True)
def test_a_layout_is_recognised_and_says_nothing_odd(miniature):
    name, root = miniature
    sized = {"icl-nuim", "tartanair"}  # their intrinsics are for 640x480

    sequence = load_sequence(root)

    assert (sequence.layout, len(sequence)) == (name, COUNT)
    notes = [note for note in sequence.notes if "scaled" not in note or name not in sized]
    of_layout = {
        "replica": "set has no timestamps; they are counted",
        "7-scenes": "7-Scenes describes its depth camera only",
    }
    assert len(notes) == (name in of_layout)
    assert all(note.startswith(of_layout[name]) for note in notes)


@pytest.mark.parametrize("miniature", WITH_TRUTH, indirect=True)
def test_every_frame_has_its_pose(miniature):
    _, root = miniature

    truth = load_sequence(root).ground_truth

    assert truth.frame_ids.tolist() == list(range(COUNT))


@pytest.mark.parametrize("miniature", OWN_POSES, indirect=True)
def test_poses_come_as_they_are_written(miniature):
    _, root = miniature

    truth = load_sequence(root).ground_truth

    np.testing.assert_allclose(truth.positions, miniatures.CENTRES, atol=1e-9)
    np.testing.assert_allclose(truth.rotations.as_matrix()[2], miniatures.matrix(2)[:3, :3], atol=1e-9)


@pytest.mark.parametrize("miniature", sorted(CALIBRATIONS), indirect=True)
@pytest.mark.parametrize("content", ["", "nonsense", "[", "\x00", "1 2 3"])
def test_a_given_camera_needs_no_calibration_that_can_be_read(miniature, content):
    name, root = miniature
    path = root / CALIBRATIONS[name]
    path.write_text(path.read_text().replace("50", "fifty") if content == "1 2 3" else content)

    with pytest.raises(SequenceError, match=path.name):
        load_sequence(root)
    for camera, expected in ((GIVEN, GIVEN), ("unknown", None)):
        sequence = load_sequence(root, camera=camera)
        assert (sequence.camera, len(sequence)) == (expected, COUNT)


@pytest.mark.parametrize("miniature", sorted(CALIBRATIONS), indirect=True)
def test_a_given_camera_needs_no_calibration_file(miniature):
    name, root = miniature
    if name == "colmap":
        pytest.skip("a COLMAP model without its cameras is none")
    (root / CALIBRATIONS[name]).unlink()

    assert load_sequence(root, layout=name.replace("eth3d-slam", "tum-rgbd"), camera=GIVEN).camera == GIVEN


def test_strecha_needs_no_camera_file_of_every_image_where_the_camera_is_given(tmp_path):
    miniatures.strecha(tmp_path)
    (tmp_path / "0002.png.camera").unlink()

    with pytest.raises(SequenceError, match=r"0002\.png\.camera"):
        load_sequence(tmp_path)
    assert load_sequence(tmp_path, camera=GIVEN).ground_truth.frame_ids.tolist() == [0, 1, 3, 4]


def test_a_camera_for_other_images_matters_only_where_it_is_used(tmp_path):
    miniatures.nerf(tmp_path, w=640, h=640)

    with pytest.raises(SequenceError, match="another shape"):
        load_sequence(tmp_path)
    assert load_sequence(tmp_path, camera="unknown").camera is None


def test_intrinsics_for_another_resolution_are_scaled_and_noted(tmp_path):
    miniatures.nerf(tmp_path, w=128, h=96)

    sequence = load_sequence(tmp_path)

    assert sequence.camera.params[:4] == (25, 25.5, 16, 12)
    assert sequence.notes == ("the intrinsics are for 128x96 images and were scaled to those of 64x48",)


@pytest.mark.parametrize("folder", ["image_0", "image_2"])
def test_kitti_without_calibration_keeps_the_poses_of_the_camera_that_they_are_of(tmp_path, folder):
    miniatures.kitti(tmp_path)
    (tmp_path / "image_0").rename(tmp_path / folder)
    (tmp_path / "calib.txt").unlink()

    sequence = load_sequence(tmp_path, camera=GIVEN)

    assert (sequence.ground_truth is not None) == (folder == "image_0")
    assert any("no calib.txt moves them" in note for note in sequence.notes) == (folder == "image_2")


@pytest.mark.parametrize("text", [None, "{}"])
def test_euroc_without_extrinsics_says_that_ground_truth_is_left_out(tmp_path, text):
    miniatures.euroc(tmp_path)
    sensor = tmp_path / "mav0" / "cam0" / "sensor.yaml"
    sensor.unlink()
    if text:
        sensor.write_text(text)

    sequence = load_sequence(tmp_path, camera="unknown")

    assert sequence.ground_truth is None
    assert "ground truth is left out" in sequence.notes[0]
    assert "sensor.yaml" in sequence.notes[0]


def test_tum_vi_has_its_poses_under_mocap0(tmp_path):
    miniatures.euroc(tmp_path)
    expected = load_sequence(tmp_path).ground_truth
    (tmp_path / "mav0" / "state_groundtruth_estimate0").rename(tmp_path / "mav0" / "mocap0")

    truth = load_sequence(tmp_path).ground_truth

    np.testing.assert_array_equal(truth.positions, expected.positions)
    np.testing.assert_array_equal(truth.quaternions, expected.quaternions)


TEXT_FILES = sorted(
    (name, path)
    for name, paths in {
        "eth3d-slam": ("rgb.txt", "calibration.txt"),
        "kitti": ("times.txt", "calib.txt"),
        "euroc": ("mav0/cam0/data.csv",),
        "replica": ("traj.txt",),
        "colmap": ("sparse/0/cameras.txt",),
        "nerf": ("transforms.json",),
    }.items()
    for path in paths
)


@pytest.mark.parametrize(("name", "path"), TEXT_FILES)
def test_a_pipe_in_place_of_a_file_does_not_hang(tmp_path, name, path):
    LAYOUTS[name](tmp_path)
    (tmp_path / path).unlink()
    os.mkfifo(tmp_path / path)

    with pytest.raises(SequenceError):
        load_sequence(tmp_path, layout=name)


@pytest.mark.parametrize("layout", sorted(LAYOUTS))
def test_a_pipe_in_place_of_an_image_does_not_hang(tmp_path, layout):
    LAYOUTS[layout](tmp_path)
    image = next(iter(sorted(path for path in tmp_path.rglob("*") if path.suffix in (".png", ".jpg"))))
    image.unlink()
    os.mkfifo(image)

    with pytest.raises(SequenceError, match="expected an image file, found a folder, a pipe or a device"):
        load_sequence(Path(tmp_path))
