"""Trajectories side by side on one axis of frames."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from gtf_tune.trajectory import FloatArray, IntArray, Trajectory, check_frame_ids
from gtf_tune.trajectory.alignment import (
    COMPARABLE_SIZE,
    INCOMPARABLE,
    AlignmentKind,
    Alignments,
    align_all,
    normalised,
)


@dataclass(frozen=True, eq=False)
class TrajectoryStack:
    """t trajectories over the same f frames.

    Attributes
    ----------
    points
        (t, 3, f): position = origin + unit * column; 0 where a trajectory lacks the frame.
    known
        (t, f): 1 where it has the frame, 0 elsewhere.
    origins, units
        (t, 3) and (t,).
    """

    points: FloatArray
    known: FloatArray
    origins: FloatArray
    units: FloatArray


@dataclass(frozen=True, eq=False)
class PairBlock:
    """One trajectory, the target, matched and aligned with each of p others, the sources.

    Attributes
    ----------
    alignments
        The maps from source to target columns.
    unit
        Lengths of target columns times this are lengths of the target.
    scales
        (p,): the same maps' scales between the trajectories themselves.
    reasons
        p sentences why a pair cannot be measured, empty where it can.
    """

    alignments: Alignments
    unit: float
    scales: FloatArray
    reasons: tuple[str, ...]

    @property
    def rmse(self) -> FloatArray:
        """Return the RMSE of positions after alignment, (p,), in the unit of the target."""
        return self.unit * np.sqrt(self.alignments.mean_squares)

    @property
    def extents(self) -> FloatArray:
        """Return the RMS distance of the matched target positions from their mean, (p,), in the unit of the target."""
        return self.unit * self.alignments.radii


def stack(trajectories: Sequence[Trajectory], frame_ids: IntArray) -> TrajectoryStack:
    """Return the trajectories over the given sorted frame ids, which hold all of theirs."""
    shape = (len(trajectories), len(frame_ids))
    points, known = np.zeros((shape[0], 3, shape[1])), np.zeros(shape)
    origins, units = np.zeros((shape[0], 3)), np.ones(shape[0])
    for row, trajectory in enumerate(trajectories):
        columns = _columns(trajectory, frame_ids)
        normal = normalised(trajectory.positions)
        points[row][:, columns], known[row, columns] = normal.points, 1.0
        origins[row], units[row] = normal.origin, normal.unit
    return TrajectoryStack(points, known, origins, units)


def _columns(trajectory: Trajectory, frame_ids: IntArray) -> slice | IntArray:
    if len(trajectory) == len(frame_ids):
        return slice(None)
    return np.searchsorted(frame_ids, trajectory.frame_ids).astype(np.int64)


def common_frames(*groups: Sequence[Trajectory]) -> IntArray:
    """Return the sorted frame ids that any of the trajectories has.

    Raises
    ------
    TrajectoryError
        Frame ids only count the poses of a file, and the trajectories have different ones.
    """
    check_frame_ids([trajectory for group in groups for trajectory in group])
    ids = [trajectory.frame_ids for group in groups for trajectory in group]
    if all(np.array_equal(other, ids[0]) for other in ids):
        return ids[0] if ids else np.empty(0, np.int64)
    return np.unique(np.concatenate(ids))


def align_block(a: TrajectoryStack, row: int, b: TrajectoryStack, rows: slice, kind: AlignmentKind) -> PairBlock:
    """Return trajectories ``rows`` of b aligned to trajectory ``row`` of a."""
    source, apart = b.points[rows], np.zeros(len(b.units[rows]), dtype=bool)
    if kind != "sim3":
        ratios = b.units[rows] / a.units[row]
        shifts = (b.origins[rows] - a.origins[row]) / a.units[row] if kind == "none" else np.zeros((len(ratios), 3))
        apart = np.maximum(ratios, np.abs(shifts).max(axis=1, initial=0.0)) > COMPARABLE_SIZE
        ratios[apart], shifts[apart] = 1.0, 0.0
        source = source * ratios[:, np.newaxis, np.newaxis] + shifts[:, :, np.newaxis]
    found = align_all(a.points[row : row + 1], source, a.known[row] * b.known[rows], kind)
    reasons = tuple(INCOMPARABLE if far else reason for far, reason in zip(apart, found.reasons, strict=True))
    scales = found.scales * (a.units[row] / b.units[rows] if kind == "sim3" else 1.0)
    return PairBlock(found, float(a.units[row]), scales, reasons)
