"""The relative pose error of pairs of trajectories.

The error of poses i and j is the motion from i to j in one trajectory, undone by the same motion in the other (Sturm et
al., "A benchmark for the evaluation of RGB-D SLAM systems", IROS 2012). Rotations and translations of the alignment
cancel in it; its scale does not. Which poses make a pair follows evo, so that results compare.
"""

from dataclasses import dataclass

import numpy as np

from gtf_tune.errors import TrajectoryError
from gtf_tune.metrics.settings import RpeSettings
from gtf_tune.trajectory import FloatArray, IntArray, Trajectory, associate_by_frame_id

# Sums of steps such as 0.1 s miss a round delta by their rounding; they are meant to reach it.
_TIE = 1e-9

PosePairIndices = tuple[IntArray, IntArray]


@dataclass(frozen=True, eq=False)
class PosePath:
    """Matched poses in order: ``times`` (m,) s, ``positions`` (m, 3), ``quaternions`` (m, 4) world_from_camera."""

    times: FloatArray
    positions: FloatArray
    quaternions: FloatArray

    def __getitem__(self, indices: IntArray) -> "PosePath":
        return PosePath(self.times[indices], self.positions[indices], self.quaternions[indices])


def relative_errors(a: PosePath, b: PosePath, settings: RpeSettings) -> FloatArray:
    """Return the error of every pair of poses, in the unit of the positions or in degrees.

    ``a`` and ``b`` hold the same frames and b is in the scale of a already. Empty when no poses lie ``delta`` apart.
    """
    first, second = pose_pairs(a.times, b.positions, settings)
    if settings.relation == "translation":
        gap = _motions(a[first], a[second]) - _motions(b[first], b[second])
        distances: FloatArray = np.linalg.norm(gap, axis=1)
        return distances
    turn_a = _product(_conjugate(a.quaternions[first]), a.quaternions[second])
    turn_b = _product(_conjugate(b.quaternions[first]), b.quaternions[second])
    return _angles_deg(_product(_conjugate(turn_a), turn_b))


def pose_pairs(times: FloatArray, positions: FloatArray, settings: RpeSettings) -> PosePairIndices:
    """Return indices of the poses that lie ``delta`` apart, by frames, by path along positions (m, 3) or by times (m,).

    Pairs of ``all`` end at the pose nearest to ``delta``, if it misses it by no more than the tolerance; for frames
    there is always one until the end. Pairs of ``consecutive`` end at the first pose that is at least ``delta`` away.
    """
    if settings.delta_unit == "frames":
        step = int(settings.delta)
        stride = step if settings.pairs == "consecutive" else 1
        first = np.arange(0, max(len(times) - step, 0), stride, dtype=np.int64)
        return first, first + step
    along = times if settings.delta_unit == "seconds" else _path(positions)
    if settings.pairs == "consecutive":
        return _chained(along, settings.delta)
    return _nearest(along, settings.delta, settings.delta * settings.tolerance)


def _path(positions: FloatArray) -> FloatArray:
    steps = np.linalg.norm(np.diff(positions, axis=0), axis=1)
    return np.concatenate([np.zeros(1), np.cumsum(steps)])


def _chained(along: FloatArray, delta: float) -> PosePairIndices:
    reach = delta * (1 - _TIE)
    stops = [0]
    while stops[-1] < len(along):
        stops.append(max(int(np.searchsorted(along, along[stops[-1]] + reach)), stops[-1] + 1))
    inside = np.array(stops[:-1], dtype=np.int64)
    return inside[:-1], inside[1:]


def _nearest(along: FloatArray, delta: float, tolerance: float) -> PosePairIndices:
    first = np.arange(max(len(along) - 1, 0), dtype=np.int64)
    after = np.searchsorted(along, along[first] + delta)
    before = np.searchsorted(along, along[np.clip(after - 1, 0, None)])
    after, before = np.clip(after, first + 1, len(along) - 1), np.clip(before, first + 1, len(along) - 1)
    misses = [np.abs(along[end] - along[first] - delta) for end in (before, after)]
    second = np.where(misses[0] <= misses[1], before, after)
    close = np.minimum(*misses) <= tolerance
    return first[close], second[close]


def _motions(start: PosePath, end: PosePath) -> FloatArray:
    """Return the centre of the end camera in the frame of the start camera, (m, 3)."""
    return _turned(_conjugate(start.quaternions), end.positions - start.positions)


def _conjugate(quaternions: FloatArray) -> FloatArray:
    conjugate: FloatArray = quaternions * np.array([-1.0, -1.0, -1.0, 1.0])
    return conjugate


def _product(left: FloatArray, right: FloatArray) -> FloatArray:
    vectors = left[:, 3:] * right[:, :3] + right[:, 3:] * left[:, :3] + np.cross(left[:, :3], right[:, :3])
    scalars = left[:, 3] * right[:, 3] - np.einsum("mc,mc->m", left[:, :3], right[:, :3])
    product: FloatArray = np.concatenate([vectors, scalars[:, np.newaxis]], axis=1)
    return product


def _turned(quaternions: FloatArray, vectors: FloatArray) -> FloatArray:
    twice = 2 * np.cross(quaternions[:, :3], vectors)
    turned: FloatArray = vectors + quaternions[:, 3:] * twice + np.cross(quaternions[:, :3], twice)
    return turned


def _angles_deg(quaternions: FloatArray) -> FloatArray:
    # The arc tangent keeps its digits for tiny angles, where the arc cosine of the scalar part loses half of them.
    halves = np.arctan2(np.linalg.norm(quaternions[:, :3], axis=1), np.abs(quaternions[:, 3]))
    angles: FloatArray = np.degrees(2 * halves)
    return angles


def matched_paths(a: Trajectory, b: Trajectory, scale: float, settings: RpeSettings) -> tuple[PosePath, PosePath]:
    """Return the poses of the frames that both have, those of b with positions times ``scale``.

    Raises
    ------
    TrajectoryError
        Poses are to lie seconds apart, but a has no times.
    """
    if settings.delta_unit == "seconds" and not a.has_timestamps:
        raise TrajectoryError(
            "expected times to find poses some seconds apart, but the trajectory has none, as for KITTI files; give "
            "the distance in frames"
        )
    ia, ib = associate_by_frame_id(a, b)
    return (
        PosePath(a.timestamps[ia], a.positions[ia], a.quaternions[ia]),
        PosePath(b.timestamps[ib], scale * b.positions[ib], b.quaternions[ib]),
    )
