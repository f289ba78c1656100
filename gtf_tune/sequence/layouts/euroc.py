"""Read the ASL layout of EuRoC MAV, also that of TUM-VI: mav0/cam0 with data.csv and sensor.yaml."""

import re
from dataclasses import replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from gtf_tune.errors import SequenceError
from gtf_tune.sequence.camera import Camera
from gtf_tune.sequence.layouts.base import Layout, Recording, check_unique
from gtf_tune.sequence.layouts.ground_truth import poses_by_timestamp
from gtf_tune.sequence.layouts.tables import read_rows, read_text
from gtf_tune.sequence.value import Frame
from gtf_tune.trajectory import Trajectory, read_trajectory

_MODELS = {"radial-tangential": "OPENCV", "radtan": "OPENCV", "equidistant": "OPENCV_FISHEYE"}


def _base(root: Path) -> Path:
    return root / "mav0" if (root / "mav0").is_dir() else root


def _read(root: Path) -> Recording:
    camera = _base(root) / "cam0"
    frames = _read_frames(camera / "data.csv")
    sensor = camera / "sensor.yaml"
    text = read_text(sensor) if sensor.is_file() else ""
    intrinsics = _read_camera(text, sensor) if text else None
    path = _base(root) / "state_groundtruth_estimate0" / "data.csv"
    if not path.is_file():
        return Recording(frames, intrinsics)
    body_from_camera = np.array(_numbers(text, "data", 16, sensor)).reshape(4, 4)
    poses = _moved_to_camera(read_trajectory(path, format="euroc"), body_from_camera)
    ground_truth, notes = poses_by_timestamp(frames, poses, path)
    return Recording(frames, intrinsics, ground_truth, notes=notes)


def _read_frames(path: Path) -> tuple[Frame, ...]:
    frames: list[Frame] = []
    for line, fields in read_rows(path, separator=","):
        if len(fields) != 2 or not fields[0].isdigit():
            raise SequenceError(
                f"{path}:{line}: expected 'nanoseconds,image', found '{','.join(fields)}'; mend the line"
            )
        frames.append(Frame(len(frames), path.parent / "data" / fields[1], int(fields[0]) * 1e-9))
    if not frames:
        raise SequenceError(f"{path}: lists no images; give a sequence that has some")
    check_unique(tuple(frames), path)
    return tuple(frames)


def _read_camera(text: str, path: Path) -> Camera:
    kind = re.search(r"^distortion_model:\s*([\w-]+)", text, re.MULTILINE)
    if kind is None or kind.group(1) not in _MODELS:
        raise SequenceError(f"{path}: expected a distortion_model among {', '.join(_MODELS)}; give the camera instead")
    width, height = _numbers(text, "resolution", 2, path)
    fx, fy, cx, cy = _numbers(text, "intrinsics", 4, path)
    distortion = _numbers(text, "distortion_coefficients", 4, path)
    return Camera(_MODELS[kind.group(1)], int(width), int(height), (fx, fy, cx + 0.5, cy + 0.5, *distortion))


def _numbers(text: str, name: str, count: int, path: Path) -> list[float]:
    """Return the numbers of ``name: [1, 2, 3]``, which may go over several lines: all the YAML that these files use."""
    found = re.search(rf"^\s*{name}:\s*\[([^\]]*)\]", text, re.MULTILINE)
    try:
        numbers = [float(number) for number in found.group(1).split(",")] if found else []
    except ValueError:
        numbers = []
    if len(numbers) != count:
        raise SequenceError(f"{path}: expected '{name}: [...]' with {count} numbers; check the file")
    return numbers


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
        "of a sequence and give its folder, which holds mav0/cam0 and mav0/state_groundtruth_estimate0."
    ),
)
