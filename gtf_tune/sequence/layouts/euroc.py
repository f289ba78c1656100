"""Read the ASL layout of EuRoC MAV, also that of TUM-VI: mav0/cam0 with data.csv and sensor.yaml."""

from dataclasses import replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from gtf_tune.errors import SequenceError
from gtf_tune.sequence.layouts.base import (
    UNKNOWN,
    Intrinsics,
    Layout,
    Reading,
    Recording,
    naming,
    one_camera,
)
from gtf_tune.sequence.layouts.cameras.sensor import sensor_camera
from gtf_tune.sequence.layouts.fields import read_yaml
from gtf_tune.sequence.layouts.ground_truth import Notes, check_near, poses_by_timestamp
from gtf_tune.sequence.layouts.tables import read_image_list
from gtf_tune.sequence.value import Frame
from gtf_tune.trajectory import Trajectory, read_trajectory

# Poses of the body, the best first: EuRoC's, then TUM-VI's, which are moved from the marker to the IMU already.
_BODY_POSES = ("state_groundtruth_estimate0", "mocap0")
_SENSOR_KEYS = frozenset(
    [
        "sensor_type",
        "comment",
        "T_BS",
        "rate_hz",
        "resolution",
        "camera_model",
        "intrinsics",
        "distortion_model",
        "distortion_coefficients",
    ]
)
_ROTATION_TOLERANCE = 1e-2


def _base(root: Path) -> Path:
    return root / "mav0" if (root / "mav0").is_dir() else root


def _read(root: Path, _: Reading) -> Recording:
    camera = _base(root) / "cam0"
    frames = read_image_list(camera / "data.csv", camera / "data", "ns")
    sensor = camera / "sensor.yaml"
    ground_truth, notes, files = _read_ground_truth(root, frames, sensor)
    return Recording(
        frames,
        lambda: _read_intrinsics(sensor),
        ground_truth,
        notes=notes,
        files=(camera / "data.csv", sensor, *files),
    )


def _read_ground_truth(
    root: Path, frames: tuple[Frame, ...], sensor: Path
) -> tuple[Trajectory | None, Notes, tuple[Path, ...]]:
    """Return the poses of the camera where the body's are there, notes on them, and the file that they come from."""
    paths = (_base(root) / folder / "data.csv" for folder in _BODY_POSES)
    path = next((path for path in paths if path.is_file()), None)
    if path is None:
        return None, (), ()
    try:
        body_from_camera = _body_from_camera(sensor)
    except SequenceError as error:
        note = f"ground truth is left out, as nothing moves the poses of the body to the camera: {error}"
        return None, (note,), (path,)
    with naming(path):
        poses = read_trajectory(path, format="euroc")
    ground_truth, notes = poses_by_timestamp(frames, _moved_to_camera(poses, body_from_camera), path)
    return ground_truth, notes, (path,)


def _body_from_camera(sensor: Path) -> NDArray[np.float64]:
    """Return the (4, 4) matrix T_BS, which stands under ``data`` or directly."""
    if not sensor.is_file():
        raise SequenceError(f"{sensor}: there is no such file; add it")
    extrinsics = read_yaml(sensor)["T_BS"]
    data = extrinsics["data"] if isinstance(extrinsics.value, dict) else extrinsics
    matrix = data.matrix(4, 4)
    rotation = matrix[:3, :3]
    with np.errstate(over="ignore", invalid="ignore"):
        is_rotation = np.abs(rotation @ rotation.T - np.eye(3)).max() < _ROTATION_TOLERANCE
    if not (np.isfinite(matrix).all() and is_rotation and np.linalg.det(rotation) > 0):
        raise data.fault("a rotation and a translation")
    check_near(matrix[:3, 3], sensor)
    return matrix


def _read_intrinsics(path: Path) -> Intrinsics:
    if not path.is_file():
        return UNKNOWN
    values = read_yaml(path)
    others = values.others(_SENSOR_KEYS)
    notes = (f"{path.name} has keys that are not read: {', '.join(others)}",) if others else ()
    with naming(path):
        return one_camera(sensor_camera(values), *notes)


def _moved_to_camera(body: Trajectory, body_from_camera: NDArray[np.float64]) -> Trajectory:
    """Turn world_from_body poses into world_from_camera."""
    rotation = Rotation.from_matrix(body_from_camera[:3, :3])
    return replace(
        body,
        positions=body.positions + body.rotations.as_matrix() @ body_from_camera[:3, 3],
        quaternions=(body.rotations * rotation).as_quat(),
    )


EUROC = Layout(
    name="euroc",
    matches=lambda root: (_base(root) / "cam0" / "data.csv").is_file(),
    read=_read,
    help=(
        "EuRoC MAV (https://projects.asl.ethz.ch/datasets/doku.php?id=kmavvisualinertialdatasets): unpack the ASL zip "
        "of a sequence and give its folder, which holds mav0/cam0 and mav0/state_groundtruth_estimate0. TUM-VI in the "
        "EuRoC format (https://cvg.cit.tum.de/data/datasets/visual-inertial-dataset) likewise, with mav0/mocap0."
    ),
)
