"""Turn what a Python function returned into the trajectory of its frames."""

import os
from pathlib import Path

import numpy as np
from numpy.typing import ArrayLike

from gtf_tune.errors import RunError, TrajectoryError
from gtf_tune.pipelines.function.images import RunImages
from gtf_tune.trajectory import (
    MAX_DIFFERENCE_S,
    Trajectory,
    associate,
    association_of,
    read_trajectory,
)

_EXPECTED = "expected the function to return a Trajectory, positions and quaternions, or the path of a trajectory file"


def trajectory_of(result: object, images: RunImages) -> Trajectory:
    """Return the poses of a result under the frame ids, times and names of the images.

    Parameters
    ----------
    result
        A trajectory, a pair of positions and quaternions, or the path of a trajectory file or COLMAP model; relative
        paths start in the workspace, else in the current folder.

    Raises
    ------
    RunError
        It is something else, holds no pose, or nothing says which images its poses belong to.
    """
    try:
        if isinstance(result, Trajectory):
            return _of_images(result, images)
        if isinstance(result, str | os.PathLike):
            inside = images.workspace / result
            return _of_images(read_trajectory(inside if inside.exists() else Path(result)), images)
        if isinstance(result, tuple) and len(result) == 2:
            return _of_arrays(*result, images)
    except TrajectoryError as error:
        raise RunError(f"the function's trajectory cannot be used: {error}") from error
    raise RunError(f"{_EXPECTED}, not {type(result).__name__}")


def _of_images(found: Trajectory, images: RunImages) -> Trajectory:
    known = _imagined(images)
    association = association_of([known, found]) if found.ids_are_counted else "frame id"
    mine, theirs = associate(known, found, association)
    strange = np.setdiff1d(np.arange(len(found)), theirs)
    if strange.size:
        raise TrajectoryError(
            f"{strange.size} of its {len(found)} poses belong to no image by {association}, the first is pose "
            f"{strange[0]}; give each pose the name, the timestamp or the frame id of its image"
        )
    chosen = known.select(mine)
    if association == "frame id" and found.has_timestamps:
        _check_times(chosen, found)
    return Trajectory(
        frame_ids=chosen.frame_ids,
        timestamps=chosen.timestamps,
        positions=found.positions,
        quaternions=found.quaternions,
        names=chosen.names,
    )


def _check_times(expected: Trajectory, found: Trajectory) -> None:
    """Raise `TrajectoryError` where times contradict frame ids, as they do where someone counted poses as frames."""
    late = np.flatnonzero(np.abs(expected.timestamps - found.timestamps) > MAX_DIFFERENCE_S)
    if late.size:
        pose = int(late[0])
        raise TrajectoryError(
            f"the pose of frame {found.frame_ids[pose]} has the time {found.timestamps[pose]:.9g} s, but its image "
            f"{expected.timestamps[pose]:.9g} s; take the frame ids and the timestamps of the images that have a pose"
        )


def _of_arrays(positions: ArrayLike, quaternions: ArrayLike, images: RunImages) -> Trajectory:
    centres, rotations = np.asarray(positions, dtype=np.float64), np.asarray(quaternions, dtype=np.float64)
    if centres.shape != (len(images), 3) or rotations.shape != (len(images), 4):
        raise TrajectoryError(
            f"expected positions of shape ({len(images)}, 3) and quaternions of shape ({len(images)}, 4), one row for "
            f"each image and NaN where it has no pose, not {centres.shape} and {rotations.shape}"
        )
    kept = np.flatnonzero(~np.isnan(np.hstack([centres, rotations])).any(axis=1))
    known = _imagined(images).select(kept)
    return Trajectory(known.frame_ids, known.timestamps, centres[kept], rotations[kept], known.names)


def _imagined(images: RunImages) -> Trajectory:
    """Return a trajectory with a pose of no meaning for every image."""
    upright = np.tile([0.0, 0.0, 0.0, 1.0], (len(images), 1))
    return Trajectory(images.frame_ids, images.timestamps, np.zeros((len(images), 3)), upright, images.names)
