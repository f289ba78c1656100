"""VSLAM-LAB's own sequences: times, cameras and poses in every way in which they were written so far."""

import numpy as np
import pytest
import yaml

from gtf_tune.errors import SequenceError
from gtf_tune.sequence import Camera, load_sequence
from tests.sequence import miniatures


def test_vslam_lab_has_the_times_the_camera_and_the_poses_that_its_headers_name(tmp_path):
    miniatures.vslam_lab(tmp_path)
    lines = (tmp_path / "rgb.csv").read_text().splitlines()
    swapped = [",".join(reversed(line.split(","))) for line in lines]
    (tmp_path / "rgb.csv").write_text("\n".join(swapped))

    sequence = load_sequence(tmp_path)

    steps = np.diff([frame.timestamp for frame in sequence.frames])
    np.testing.assert_allclose(steps, miniatures.PERIOD_S, atol=1e-6)
    assert sequence.camera == Camera("FULL_OPENCV", 64, 48, (50, 51, 32, 24, 0.1, 0, 0, 0, 0.2, 0, 0, 0))


@pytest.mark.parametrize(
    ("header", "unit"),
    [
        ("ts_rgb_0 (ns),path_rgb_0,ts_rgb_1 (ns),path_rgb_1", 1),
        ("ts_depth_0 (ns),path_depth_0,ts_rgb_0 (ns),path_rgb_0", 1),
        ("ts_rgb_1 (ns),path_rgb_1,ts_rgb_0 (ns),path_rgb_0", 1),
        ("ts_rgb0 (s),path_rgb0", 10**9),
        ("ts_rgb_0 [us],path_rgb_0", 10**3),
        ("timestamp (ms),path_rgb_0", 10**6),
        ("ts_rgb_0,path_rgb_0", 1),
    ],
)
def test_vslam_lab_has_the_times_of_its_first_camera_in_any_unit(tmp_path, header, unit):
    miniatures.vslam_lab(tmp_path)
    rows = []
    for n in range(miniatures.COUNT):
        time = str(miniatures.stamp(n) if unit == 1 else miniatures.stamp(n) / unit)
        ours = {"path_rgb": f"rgb_0/{n:06d}.png", "ts": time}
        others = {"path": f"other/{n}.png", "ts": f"{10**8 * n}"}
        cells = [
            others[title.split("_")[0]]
            if "depth" in title or "rgb_1" in title
            else ours["path_rgb" if "path" in title else "ts"]
            for title in header.split(",")
        ]
        rows.append(",".join(cells))
    miniatures.text(tmp_path / "rgb.csv", [header, *rows])

    sequence = load_sequence(tmp_path)

    start = sequence.frames[0].timestamp
    assert start == pytest.approx(miniatures.START_NS / 1e9, abs=1e-3)
    assert sequence.frames[-1].timestamp - start == pytest.approx(4 * miniatures.PERIOD_S, abs=1e-5)
    assert len(sequence.ground_truth) == miniatures.COUNT
    assert sequence.camera is not None
    assert bool(sequence.notes) == ("rgb_1" in header)


def test_vslam_lab_without_any_unit_is_refused_where_times_do_not_show_it(tmp_path):
    miniatures.vslam_lab(tmp_path)
    rows = [f"{n * 200},rgb_0/{n:06d}.png" for n in range(miniatures.COUNT)]
    miniatures.text(tmp_path / "rgb.csv", ["ts_rgb_0,path_rgb_0", *rows])

    with pytest.raises(SequenceError, match=r"rgb\.csv: nothing says the unit of its times; write it into the header"):
        load_sequence(tmp_path)


@pytest.mark.parametrize(
    ("changes", "camera"),
    [
        ({"image_dimension": [0, 0]}, ("FULL_OPENCV", 50.0)),
        ({"cam_name": "rgb0"}, ("FULL_OPENCV", 50.0)),
        ({"cam_model": "radtan5", "distortion_type": None}, ("FULL_OPENCV", 50.0)),
        ({"distortion_type": "equid4", "distortion_coefficients": [0.1, 0, 0, 0]}, ("OPENCV_FISHEYE", 50.0)),
    ],
)
def test_vslam_lab_writes_cameras_in_several_ways(tmp_path, changes, camera):
    miniatures.vslam_lab(tmp_path)
    path = tmp_path / "calibration.yaml"
    [first] = yaml.safe_load(path.read_text())["cameras"]
    changed = {key: value for key, value in (first | changes).items() if value is not None}
    other = {**first, "cam_name": "rgb_1", "focal_length": [70.0, 70.0]}
    path.write_text("%YAML 1.2\n---\n" + yaml.safe_dump({"cameras": [other, changed]}))

    sequence = load_sequence(tmp_path)

    assert (sequence.camera.model, sequence.camera.params[0]) == camera
    assert (sequence.camera.width, sequence.camera.height) == (64, 48)


def test_vslam_lab_says_that_poses_may_be_those_of_a_body(tmp_path):
    miniatures.vslam_lab(tmp_path)
    path = tmp_path / "calibration.yaml"
    [camera] = yaml.safe_load(path.read_text())["cameras"]
    notes = []
    for shift in (0.0, 0.1):
        moved = np.eye(4) + shift * np.eye(4, k=3)
        path.write_text(yaml.safe_dump({"cameras": [{**camera, "T_BS": moved.ravel().tolist()}]}))
        notes.append(load_sequence(tmp_path).notes)

    assert notes == [
        (),
        ("ground truth is taken for poses of the camera, though calibration.yaml has a T_BS that moves it",),
    ]


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ("cam_model: pinhole", "cam_model: omni", "expected cam_model pinhole or unknown, found 'omni'"),
        ("radtan5", "scaramuzza", "expected a distortion_model among"),
        ("cam_name: rgb_0", "cam_name: rgb_7", "expected a camera with cam_name 'rgb_0'"),
    ],
)
def test_vslam_lab_with_another_camera_is_refused(tmp_path, old, new, message):
    miniatures.vslam_lab(tmp_path)
    path = tmp_path / "calibration.yaml"
    path.write_text(path.read_text().replace(old, new))

    with pytest.raises(SequenceError, match=rf"calibration\.yaml: {message}.*give the camera"):
        load_sequence(tmp_path)


def test_vslam_lab_may_not_know_the_camera_nor_poses(tmp_path):
    miniatures.vslam_lab(tmp_path)
    path = tmp_path / "calibration.yaml"
    path.write_text(path.read_text().replace("cam_model: pinhole", "cam_model: unknown"))
    (tmp_path / "groundtruth.csv").write_text("ts (ns),tx (m),ty (m),tz (m),qx,qy,qz,qw\n")

    sequence = load_sequence(tmp_path)

    assert (sequence.camera, sequence.ground_truth) == (None, None)
    assert sequence.notes == ("groundtruth.csv holds no poses",)


@pytest.mark.parametrize("camera", ["auto", "unknown"])
def test_vslam_lab_mirrors_what_has_y_pointing_up(tmp_path, camera):
    miniatures.vslam_lab(tmp_path)
    path = tmp_path / "calibration.yaml"
    [first] = yaml.safe_load(path.read_text())["cameras"]
    upright = load_sequence(tmp_path)
    path.write_text(yaml.safe_dump({"cameras": [{**first, "focal_length": [50.0, -51.0]}]}))

    sequence = load_sequence(tmp_path, camera=camera)

    assert sequence.camera == (upright.camera if camera == "auto" else None)
    np.testing.assert_array_equal(
        sequence.ground_truth.positions, upright.ground_truth.positions * np.array([1.0, -1.0, 1.0])
    )
    mirror = np.diag([1.0, -1.0, 1.0])
    np.testing.assert_allclose(
        sequence.ground_truth.rotations.as_matrix(), mirror @ upright.ground_truth.rotations.as_matrix() @ mirror
    )
    assert "camera and poses are mirrored" in sequence.notes[0]
