"""Match the poses that come with a data set to its frames."""

import re
from dataclasses import replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from gtf_tune.errors import SequenceError
from gtf_tune.sequence.value import Frame
from gtf_tune.trajectory import Trajectory, associate_by_timestamp

Frames = tuple[Frame, ...]
Notes = tuple[str, ...]

# The TUM RGB-D benchmark's own default for matching images to poses.
MAX_DIFFERENCE_S = 0.02

_NUMBER = re.compile(r"[0-9]{1,18}")
_UPRIGHT = np.array([[0.0, 0.0, 0.0, 1.0]])
_ORTHOGONALITY_TOLERANCE = 1e-3
_FARTHEST = 1e100
_HALF = 0.5
_DRIFT = 0.02  # by which the rate of a recording may change


def poses_by_timestamp(frames: Frames, poses: Trajectory, source: Path) -> tuple[Trajectory | None, Notes]:
    """Give each frame the pose nearest in time, each pose once, if it is at most 0.02 s away.

    Returns
    -------
    ground_truth, notes
        The poses under their frames' ids and timestamps, or ``None`` and a note if no frame has one.
    """
    check_near(poses.positions, source)
    everywhere = _trajectory(
        frames, np.arange(len(frames)), np.zeros((len(frames), 3)), _UPRIGHT.repeat(len(frames), 0)
    )
    matched, nearest = associate_by_timestamp(everywhere, poses, MAX_DIFFERENCE_S)
    if not len(matched):
        return None, (f"{source.name} has {len(poses)} poses, but none within {MAX_DIFFERENCE_S} s of an image",)
    return _trajectory(frames, matched, poses.positions[nearest], poses.quaternions[nearest]), ()


def poses_by_line(frames: Frames, poses: Trajectory, source: Path) -> tuple[Trajectory | None, Notes]:
    """Give each frame the pose of its line, of a file without times.

    Line n, from 0, is that of the nth image where there is a line for every image. Where images were cut and lines were
    not, it is that of the image that is called by the number n.

    Returns
    -------
    ground_truth, notes
        The poses under their frames' ids and timestamps, or ``None`` and a note where nothing says whose they are.
    """
    check_near(poses.positions, source)
    counts = f"{source.name} has {len(poses)} poses for {len(frames)} images"
    if len(frames) == len(poses):
        return _trajectory(frames, np.arange(len(frames)), poses.positions, poses.quaternions), ()
    names = [frame.path.stem for frame in frames]
    lines = np.array([int(name) if _NUMBER.fullmatch(name) else -1 for name in names], dtype=np.int64)
    if lines.min() < 0 or lines.max() >= len(poses) or (np.diff(lines) <= 0).any():
        return None, (f"{counts}, and their names do not say which belong together: no ground truth is used",)
    if _were_renumbered(lines, np.array([frame.timestamp for frame in frames]), len(poses)):
        return None, (f"{counts}, and the numbers of the images contradict their times: no ground truth is used",)
    truth = _trajectory(frames, np.arange(len(frames)), poses.positions[lines], poses.quaternions[lines])
    return truth, (f"{counts}: each image has the pose in the line of its number",)


def _were_renumbered(lines: NDArray[np.int64], times: NDArray[np.float64], num_lines: int) -> bool:
    """Return True if times that count from the first line are later than the numbers of the images say."""
    if len(lines) < 2:
        return False
    step = float(np.median(np.diff(times)) / np.median(np.diff(lines)))
    usual = lines[0] * step
    return bool(times[0] < num_lines * step and times[0] - usual > _HALF * step + _DRIFT * usual)


def poses_from_matrices(frames: Frames, world_from_camera: NDArray[np.float64], source: Path) -> Trajectory | None:
    """Return the ground truth of (n, 4, 4) or (n, 3, 4) matrices, one per frame; NaN or infinity marks a gap.

    Raises
    ------
    SequenceError
        A matrix is not a rotation and a translation.
    """
    valid = np.flatnonzero(np.isfinite(world_from_camera).all(axis=(1, 2)))
    if not len(valid):
        return None
    matrices = world_from_camera[valid]
    wrong = ~_are_poses(matrices)
    if wrong.any():
        image = frames[valid[np.argmax(wrong)]].path.name
        raise SequenceError(f"{source}: the pose of image {image} is not a rotation and a translation; check the file")
    rotations = Rotation.from_matrix(matrices[:, :3, :3]).as_quat()
    return _trajectory(frames, valid, matrices[:, :3, 3], rotations)


def _are_poses(matrices: NDArray[np.float64]) -> NDArray[np.bool_]:
    """Return for (n, 3 or 4, 4) matrices whether each is a rotation, a translation, and 0 0 0 1 below them."""
    rotations = np.clip(matrices[:, :3, :3], -2, 2)  # larger numbers are wrong too, but would overflow
    residuals = np.abs(rotations @ rotations.transpose(0, 2, 1) - np.eye(3)).max(axis=(1, 2))
    proper = (residuals <= _ORTHOGONALITY_TOLERANCE) & (np.linalg.det(rotations) > 0)
    last_rows = np.abs(matrices[:, 3:] - np.array([0.0, 0, 0, 1])).max(axis=(1, 2), initial=0.0)
    near = np.abs(matrices[:, :3, 3]).max(axis=1) < _FARTHEST
    answer: NDArray[np.bool_] = proper & near & (last_rows <= _ORTHOGONALITY_TOLERANCE)
    return answer


def mirrored(poses: Trajectory) -> Trajectory:
    """Mirror world and camera at y = 0: what has y pointing up in both, as ICL-NUIM's renderer, becomes right-handed.

    With S = diag(1, -1, 1), R becomes S R S and t becomes S t; the quaternion then changes the signs of x and z.
    """
    return replace(
        poses,
        positions=poses.positions * np.array([1.0, -1, 1]),
        quaternions=poses.quaternions * np.array([-1.0, 1, -1, 1]),
    )


def check_near(positions: NDArray[np.float64], source: Path) -> None:
    """Raise `SequenceError` for positions (..., 3) that no distance can be computed from."""
    if np.abs(positions).max(initial=0.0) >= _FARTHEST:
        raise SequenceError(f"{source}: expected positions of a camera, found one beyond {_FARTHEST:g}; check the file")


def _trajectory(
    frames: Frames, chosen: NDArray[np.int64], positions: NDArray[np.float64], quaternions: NDArray[np.float64]
) -> Trajectory:
    return Trajectory(
        frame_ids=np.array([frames[index].frame_id for index in chosen], dtype=np.int64),
        timestamps=np.array([frames[index].timestamp for index in chosen]),
        positions=positions,
        quaternions=quaternions,
    )
