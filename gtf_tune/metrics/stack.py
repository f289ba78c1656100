"""Put trajectories side by side on one axis of frames."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from gtf_tune.alignment import AlignmentKind, Alignments, align_all, normalised
from gtf_tune.trajectory import FloatArray, IntArray, Trajectory

_COMPARABLE = 1e100
_INCOMPARABLE = (
    "expected trajectories of comparable size, but the second is over 1e100 times larger; look for divergence"
)


@dataclass(frozen=True, eq=False)
class TrajectoryStack:
    """Hold t trajectories over the same f frames.

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
    """Hold p matched and aligned pairs of trajectories.

    Attributes
    ----------
    pairs
        Indices (p,) of the targets and (p,) of the sources.
    target, source, weights
        What was aligned: points as columns (p, 3, f), and (p, f).
    alignments
        The maps from source to target columns.
    units
        (p,): lengths of target columns times this are lengths of the target trajectories.
    scales
        (p,): the same maps' scales between the trajectories themselves.
    reasons
        p sentences why a pair cannot be measured, empty where it can.
    """

    pairs: tuple[IntArray, IntArray]
    target: FloatArray
    source: FloatArray
    weights: FloatArray
    alignments: Alignments
    units: FloatArray
    scales: FloatArray
    reasons: tuple[str, ...]

    @property
    def residuals(self) -> FloatArray:
        """Return target minus aligned source, (p, 3, f), 0 at frames that are not matched."""
        found = self.alignments
        moved = (found.scales[:, np.newaxis, np.newaxis] * found.rotations) @ self.source
        moved += found.translations[:, :, np.newaxis]
        np.subtract(self.target, moved, out=moved)
        moved *= self.weights[:, np.newaxis]
        return moved


def stack(trajectories: Sequence[Trajectory], frame_ids: IntArray) -> TrajectoryStack:
    """Return the trajectories over the given sorted frame ids, which hold all of theirs."""
    shape = (len(trajectories), len(frame_ids))
    points, known = np.zeros((shape[0], 3, shape[1])), np.zeros(shape)
    origins, units = np.zeros((shape[0], 3)), np.ones(shape[0])
    for row, trajectory in enumerate(trajectories):
        columns = np.searchsorted(frame_ids, trajectory.frame_ids)
        normal = normalised(trajectory.positions)
        points[row][:, columns], known[row, columns] = normal.points, 1.0
        origins[row], units[row] = normal.origin, normal.unit
    return TrajectoryStack(points, known, origins, units)


def common_frames(*groups: Sequence[Trajectory]) -> IntArray:
    """Return the sorted frame ids that any of the trajectories has."""
    ids = [trajectory.frame_ids for group in groups for trajectory in group]
    return np.unique(np.concatenate(ids)) if ids else np.empty(0, np.int64)


def align_block(
    a: TrajectoryStack, b: TrajectoryStack, pairs: tuple[IntArray, IntArray], kind: AlignmentKind
) -> PairBlock:
    """Return trajectories ``b[pairs[1]]`` aligned to ``a[pairs[0]]``."""
    first, second = pairs
    target, source = a.points[first], b.points[second]
    weights = a.known[first] * b.known[second]
    ratios = np.ones(len(first))
    shifts = np.zeros((len(first), 3))
    if kind != "sim3":
        ratios = b.units[second] / a.units[first]
    if kind == "none":
        shifts = (b.origins[second] - a.origins[first]) / a.units[first, np.newaxis]
    apart = np.maximum(ratios, np.abs(shifts).max(axis=1, initial=0.0)) > _COMPARABLE
    ratios[apart], shifts[apart] = 1.0, 0.0
    source *= ratios[:, np.newaxis, np.newaxis]
    source += shifts[:, :, np.newaxis]
    found = align_all(target, source, weights, kind)
    reasons = tuple(_INCOMPARABLE if far else reason for far, reason in zip(apart, found.reasons, strict=True))
    scales = found.scales * (a.units[first] / b.units[second] if kind == "sim3" else 1.0)
    return PairBlock(pairs, target, source, weights, found, a.units[first], scales, reasons)
