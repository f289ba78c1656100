"""Kalibr's chain of cameras is read where a data set has no other calibration."""

import pytest
import yaml

from gtf_tune.errors import SequenceError
from gtf_tune.sequence import Camera, load_sequence
from tests.sequence import miniatures

FIRST = {
    "camera_model": "pinhole",
    "intrinsics": [50.0, 51.0, 31.5, 23.5],
    "distortion_model": "radtan",
    "distortion_coeffs": [0.1, 0.2, 0.0, 0.0],
    "resolution": [64, 48],
    "rostopic": "/cam0/image_raw",
    "T_cam_imu": [[1, 0, 0, 0], [0, 1, 0, 0], [0, 0, 1, 0], [0, 0, 0, 1]],
}
SECOND = {**FIRST, "distortion_model": "equidistant", "intrinsics": [60.0, 60.0, 31.5, 23.5]}
OPENCV = Camera("OPENCV", 64, 48, (50, 51, 32, 24, 0.1, 0.2, 0, 0))
FISHEYE = Camera("OPENCV_FISHEYE", 64, 48, (60, 60, 32, 24, 0.1, 0.2, 0, 0))


@pytest.mark.parametrize(
    ("folder", "name", "chain", "camera", "note"),
    [
        ("photos", "camchain.yaml", {"cam0": FIRST}, OPENCV, "intrinsics come from camchain.yaml"),
        (
            "photos",
            "rig-camchain-imucam.yml",
            {"cam0": SECOND},
            FISHEYE,
            "intrinsics come from rig-camchain-imucam.yml",
        ),
        ("cam1", "camchain.yaml", {"cam0": FIRST, "cam1": SECOND}, FISHEYE, "camchain.yaml, cam1 of 2 cameras"),
        ("photos", "camchain.yaml", {"cam0": FIRST, "cam1": SECOND}, OPENCV, "camchain.yaml, cam0 of 2 cameras"),
    ],
)
def test_a_chain_beside_photographs_is_their_camera(tmp_path, folder, name, chain, camera, note):
    root = tmp_path / folder
    miniatures.folder(root)
    (root / name).write_text(yaml.safe_dump(chain))

    sequence = load_sequence(root)

    assert sequence.camera == camera
    assert note in sequence.notes[0]


def test_a_chain_counts_only_where_nothing_else_is_known(tmp_path):
    miniatures.tum(tmp_path)
    (tmp_path / "camchain.yaml").write_text(yaml.safe_dump({"cam0": SECOND}))
    own = load_sequence(tmp_path)
    (tmp_path / "calibration.txt").unlink()

    assert own.camera == Camera("PINHOLE", 64, 48, (50, 51, 32, 24))
    assert own.notes == ("files that may describe camera or poses and are not read: camchain.yaml",)
    assert load_sequence(tmp_path).camera == FISHEYE


@pytest.mark.parametrize(
    ("chain", "message"),
    [
        (
            {"cam0": {**FIRST, "camera_model": "omni", "intrinsics": [0.8, 50, 50, 31, 23]}},
            "found 'omni'.*give the cam",
        ),
        ({"cam0": {**FIRST, "camera_model": "ds", "intrinsics": [0, 0.5, 50, 50, 31, 23]}}, "found 'ds'.*give the cam"),
        ({"imu0": {}}, "expected cameras cam0, cam1"),
        ({"cam0": {"camera_model": "pinhole"}}, "cam0: expected a key"),
    ],
)
def test_another_chain_is_refused_unless_the_camera_is_given(tmp_path, chain, message):
    miniatures.folder(tmp_path)
    (tmp_path / "camchain.yaml").write_text(yaml.safe_dump(chain))

    with pytest.raises(SequenceError, match=rf"camchain\.yaml: .*{message}"):
        load_sequence(tmp_path)
    assert load_sequence(tmp_path, camera="unknown").camera is None
