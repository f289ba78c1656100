"""Find the poses of two trajectories that belong together."""

from collections.abc import Sequence

import numpy as np

from gtf_tune.errors import TrajectoryError
from gtf_tune.trajectory.value import FloatArray, IntArray, Trajectory

Matches = tuple[IntArray, IntArray]


def associate_by_frame_id(a: Trajectory, b: Trajectory) -> Matches:
    """Return indices (m,) into a and (m,) into b of the poses with equal frame ids, in order.

    Raises
    ------
    TrajectoryError
        Frame ids of one only count its poses, and the other has different ones.
    """
    check_frame_ids([a, b])
    _, ia, ib = np.intersect1d(a.frame_ids, b.frame_ids, assume_unique=True, return_indices=True)
    return ia.astype(np.int64), ib.astype(np.int64)


def check_frame_ids(trajectories: Sequence[Trajectory]) -> None:
    """Refuse to match frame ids that only count the poses of a file, unless all trajectories have the same ones.

    Trajectories without poses (of failed runs) are left out: nothing is matched with them.

    Raises
    ------
    TrajectoryError
        One has ``ids_are_counted``, and the frame ids of another differ.
    """
    filled = [trajectory for trajectory in trajectories if len(trajectory)]
    counted = next((trajectory for trajectory in filled if trajectory.ids_are_counted), None)
    if counted is None:
        return
    for other in filled:
        if not np.array_equal(counted.frame_ids, other.frame_ids):
            raise TrajectoryError(
                f"expected poses of the same frames, but one trajectory has {len(counted)} poses that are only "
                f"numbered by their order and another has {len(other)}; associate them by timestamp or image name"
            )


def associate_by_name(a: Trajectory, b: Trajectory) -> Matches:
    """Return indices (m,) into a and (m,) into b of the poses with equal image names, in the order of a.

    Raises
    ------
    TrajectoryError
        A trajectory has no names, has a name twice, or the two have their common names in different orders.
    """
    in_b = {name: index for index, name in enumerate(_unique_names(b, "second"))}
    ia = [index for index, name in enumerate(_unique_names(a, "first")) if name in in_b]
    ib = np.array([in_b[a.names[index]] for index in ia], dtype=np.int64)
    if (np.diff(ib) <= 0).any():
        raise TrajectoryError(
            "expected the common image names of both trajectories in the same order; sort one of them"
        )
    return np.array(ia, dtype=np.int64), ib


def associate_by_timestamp(
    a: Trajectory, b: Trajectory, max_difference_s: float = 0.02, offset_s: float = 0.0
) -> Matches:
    """Return indices (m,) into a and (m,) into b of the poses closest in time, each pose used at most once.

    A pair is made when each pose is the other's nearest and they lie at most ``max_difference_s`` apart after
    ``offset_s`` was added to the timestamps of b.

    Raises
    ------
    TrajectoryError
        Timestamps are not strictly increasing, or a trajectory has no times.
    """
    times_a, times_b = _increasing_times(a, "first"), _increasing_times(b, "second") + offset_s
    if not (len(a) and len(b)):
        return np.empty(0, np.int64), np.empty(0, np.int64)
    nearest_b, nearest_a = _nearest(times_b, times_a), _nearest(times_a, times_b)
    ia = np.arange(len(a), dtype=np.int64)
    mutual = nearest_a[nearest_b] == ia
    close = np.abs(times_b[nearest_b] - times_a) <= max_difference_s
    return ia[mutual & close], nearest_b[mutual & close]


def matched(a: Trajectory, b: Trajectory, matches: Matches) -> tuple[Trajectory, Trajectory]:
    """Return both trajectories cut to the matches, b under the frame ids of a, as the metrics expect them."""
    ia, ib = matches
    cut = a.select(ia)
    return cut, b.select(ib).with_frame_ids(cut.frame_ids)


def _nearest(sorted_times: FloatArray, times: FloatArray) -> IntArray:
    right = np.clip(np.searchsorted(sorted_times, times), 1, max(len(sorted_times) - 1, 1))
    left = right - 1
    right = np.minimum(right, len(sorted_times) - 1)
    take_right = sorted_times[right] - times < times - sorted_times[left]
    return np.where(take_right, right, left).astype(np.int64)


def _increasing_times(trajectory: Trajectory, which: str) -> FloatArray:
    if len(trajectory) and not trajectory.has_timestamps:
        raise TrajectoryError(
            f"expected times, but the {which} trajectory has none; associate by frame id or image name instead"
        )
    late = np.flatnonzero(np.diff(trajectory.timestamps) <= 0)
    if late.size:
        first = int(late[0])
        raise TrajectoryError(
            f"expected strictly increasing timestamps, but in the {which} trajectory pose {first + 1} "
            f"({trajectory.timestamps[first + 1]:.9g} s) is not later than pose {first}; associate by frame id instead"
        )
    return trajectory.timestamps


def _unique_names(trajectory: Trajectory, which: str) -> tuple[str, ...]:
    if len(trajectory) and not trajectory.names:
        raise TrajectoryError(
            f"expected image names, but the {which} trajectory has none; associate by frame id instead"
        )
    if len(set(trajectory.names)) != len(trajectory.names):
        raise TrajectoryError(f"expected unique image names, but the {which} trajectory has one of them twice")
    return trajectory.names
