"""Read trajectory files that hold one pose a line: TUM, KITTI and EuRoC."""

import math
from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from itertools import pairwise
from pathlib import Path

import numpy as np
from scipy.spatial.transform import Rotation

from gtf_tune.errors import TrajectoryError
from gtf_tune.trajectory.value import Trajectory

UNIT_TOLERANCE = 1e-2
"""How far rounded rotations may be from unit length; farther off they are other numbers in the wrong columns."""

_TUM_COLUMNS = 8
_KITTI_COLUMNS = 12
_EUROC_COLUMNS = 8
_NANOSECONDS = 1_000_000_000
_LARGEST_COSINE = 1 + UNIT_TOLERANCE


@dataclass(frozen=True)
class Pose:
    """Hold one pose of a file: ``where`` it stands, ``position`` and ``quaternion`` x, y, z, w, world_from_camera."""

    where: str
    timestamp: float
    position: tuple[float, ...]
    quaternion: tuple[float, ...]


def read_tum(path: Path) -> Trajectory:
    """Read lines of ``timestamp tx ty tz qx qy qz qw``, world_from_camera, timestamps in seconds."""
    return _read(path, _tum_pose)


def read_kitti(path: Path) -> Trajectory:
    """Read lines of the 12 numbers of a (3, 4) matrix world_from_camera, row by row; timestamps count lines from 0."""
    return replace(_read(path, _kitti_pose), has_timestamps=False)


def read_euroc(path: Path) -> Trajectory:
    """Read lines of ``timestamp [ns], px, py, pz, qw, qx, qy, qz, ...``, as in EuRoC's ground-truth folders.

    These are poses of the body, or of the marker, not of a camera.
    """
    return _read(path, _euroc_pose)


def data_lines(path: Path) -> Iterator[tuple[str, str]]:
    """Yield the place and the text of each line that is neither empty nor a comment."""
    for number, line in enumerate(read_text(path).split("\n"), start=1):
        text = line.strip()
        if text and not text.startswith("#"):
            yield f"{path}, line {number}", text


def read_text(path: Path) -> str:
    """Return the text of a file.

    Raises
    ------
    TrajectoryError
        The file cannot be read or is not UTF-8.
    """
    try:
        return read_binary(path).decode("utf-8-sig")
    except UnicodeDecodeError as error:
        raise TrajectoryError(f"expected a text file, but {path} is not UTF-8 from byte {error.start} on") from error


def read_binary(path: Path) -> bytes:
    """Return the bytes of a file.

    Raises
    ------
    TrajectoryError
        The file cannot be read.
    """
    try:
        return path.read_bytes()
    except (OSError, ValueError) as error:
        reason = error.strerror if isinstance(error, OSError) else str(error)
        raise TrajectoryError(f"expected a readable trajectory file, but {path} is not ({reason})") from error


def finite_numbers(tokens: list[str], where: str, expected: str) -> tuple[float, ...]:
    """Return the tokens as numbers.

    Raises
    ------
    TrajectoryError
        One is not a finite number.
    """
    try:
        numbers = tuple(float(token) for token in tokens)
    except ValueError as error:
        raise TrajectoryError(f"{where}: expected {expected} ({error})") from error
    if not all(math.isfinite(number) for number in numbers):
        raise TrajectoryError(f"{where}: expected {expected}, but a number is NaN or infinite; drop the line")
    return numbers


def checked_quaternion(quaternion: tuple[float, ...], where: str) -> tuple[float, ...]:
    """Return the quaternion if it has unit length but for rounding.

    Raises
    ------
    TrajectoryError
        It has not.
    """
    length = math.hypot(*quaternion)
    if abs(length - 1) > UNIT_TOLERANCE:
        raise TrajectoryError(f"{where}: expected a unit quaternion, but its length is {length:.6g}; check the columns")
    return quaternion


def _read(path: Path, parse: Callable[[str, str, int], Pose]) -> Trajectory:
    poses = [parse(where, text, index) for index, (where, text) in enumerate(data_lines(path))]
    if not poses:
        raise TrajectoryError(f"expected at least one pose in {path}, but it holds none")
    for before, after in pairwise(poses):
        if after.timestamp <= before.timestamp:
            raise TrajectoryError(
                f"{after.where}: expected a later timestamp than the {before.timestamp:.9f} s before it, "
                f"not {after.timestamp:.9f} s; sort the file and drop duplicates"
            )
    return Trajectory(
        frame_ids=np.arange(len(poses)),
        timestamps=np.array([pose.timestamp for pose in poses]),
        positions=np.array([pose.position for pose in poses]),
        quaternions=np.array([pose.quaternion for pose in poses]),
        ids_are_counted=True,
    )


def _tum_pose(where: str, text: str, _: int) -> Pose:
    tokens = text.split()
    expected = f"{_TUM_COLUMNS} numbers 'timestamp tx ty tz qx qy qz qw'"
    if len(tokens) != _TUM_COLUMNS:
        raise TrajectoryError(f"{where}: expected {expected}, not {len(tokens)} columns")
    numbers = finite_numbers(tokens, where, expected)
    return Pose(where, numbers[0], numbers[1:4], checked_quaternion(numbers[4:], where))


def _kitti_pose(where: str, text: str, index: int) -> Pose:
    tokens = text.split()
    expected = f"the {_KITTI_COLUMNS} numbers of a 3x4 matrix"
    if len(tokens) != _KITTI_COLUMNS:
        raise TrajectoryError(f"{where}: expected {expected}, not {len(tokens)} columns")
    matrix = np.array(finite_numbers(tokens, where, expected)).reshape(3, 4)
    return Pose(where, float(index), tuple(matrix[:, 3].tolist()), _quaternion(matrix[:, :3], where))


def _euroc_pose(where: str, text: str, _: int) -> Pose:
    tokens = text.split(",")
    expected = f"at least {_EUROC_COLUMNS} columns 'timestamp [ns], px, py, pz, qw, qx, qy, qz'"
    if len(tokens) < _EUROC_COLUMNS:
        raise TrajectoryError(f"{where}: expected {expected} separated by commas, not {len(tokens)}")
    x, y, z, qw, qx, qy, qz = finite_numbers(tokens[1:_EUROC_COLUMNS], where, expected)
    return Pose(where, _seconds(tokens[0], where), (x, y, z), checked_quaternion((qx, qy, qz, qw), where))


def _seconds(nanoseconds: str, where: str) -> float:
    try:
        return int(nanoseconds) / _NANOSECONDS
    except (ValueError, OverflowError) as error:
        message = f"{where}: expected a timestamp in whole nanoseconds, not '{nanoseconds.strip()[:40]}'"
        raise TrajectoryError(message) from error


def _quaternion(matrix: np.ndarray[tuple[int, int], np.dtype[np.float64]], where: str) -> tuple[float, ...]:
    small = bool((np.abs(matrix) <= _LARGEST_COSINE).all())
    if not small or np.abs(matrix @ matrix.T - np.eye(3)).max() > UNIT_TOLERANCE or np.linalg.det(matrix) < 0:
        raise TrajectoryError(
            f"{where}: expected a rotation in the first three columns of the 3x4 matrix, not another one"
        )
    return tuple(Rotation.from_matrix(matrix).as_quat().tolist())
