"""Match the poses of two trajectory files, and explain in their terms where too few belong together."""

import math
from pathlib import Path
from types import MappingProxyType
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from gtf_tune.trajectory import Trajectory, TrajectoryFormat

_COUNTED = MappingProxyType(
    {
        "kitti": "a KITTI file, which holds no times: the numbers of its lines stand for them",
        "colmap": "a COLMAP model, which holds no times: the numbers of its frames stand for them",
    }
)
_UNITS = MappingProxyType({3: "milliseconds", 6: "microseconds", 9: "nanoseconds"})
_SURE = 0.5
"""How far the logarithm of a ratio of durations may be from that of two units."""


def matched_files(
    reference: Path, estimate: Path, format_: "TrajectoryFormat", max_difference_s: float
) -> tuple["Trajectory", "Trajectory"]:
    """Return both trajectories with equal frame ids where their timestamps, or their image names, agree.

    Raises
    ------
    TrajectoryError
        A file cannot be read, or fewer than 4 poses agree; the message says by what, and what to change.
    """
    from gtf_tune.errors import TrajectoryError
    from gtf_tune.trajectory import associate_by_name, associate_by_timestamp, matched, read_trajectory
    from gtf_tune.trajectory.alignment import MIN_MATCHED

    first, second = (read_trajectory(path, format_) for path in (reference, estimate))
    by_name = bool(first.names and second.names)
    found = associate_by_name(first, second) if by_name else associate_by_timestamp(first, second, max_difference_s)
    count = len(found[0])
    if count >= MIN_MATCHED:
        return matched(first, second, found)
    ends = {reference: first, estimate: second}
    short = [f"{path} holds only {len(one)}" for path, one in ends.items() if len(one) < MIN_MATCHED]
    if short:
        reason = f"{' and '.join(short)}; give longer trajectories"
    elif by_name:
        reason = _about_names(ends)
    else:
        reason = _about_times(ends, format_, max_difference_s)
    raise TrajectoryError(
        f"expected at least {MIN_MATCHED} poses that {reference} and {estimate} share, not {count}: {reason}"
    )


def _about_names(ends: dict[Path, "Trajectory"]) -> str:
    shown = " and ".join(f"'{one.names[0]}' to '{one.names[-1]}' in {path}" for path, one in ends.items())
    return f"they were matched by image names, {shown}; give models of the same images under the same names"


def _about_times(ends: dict[Path, "Trajectory"], format_: "TrajectoryFormat", max_difference_s: float) -> str:
    shown = " and ".join(f"{_time(one, 0)} to {_time(one, -1)} s in {path}" for path, one in ends.items())
    told = f"they were matched by timestamps within --max-difference {max_difference_s:g} s, {shown}"
    return f"{told}; {_counted(ends, format_) or _other_unit(ends) or _other_clock(ends, max_difference_s)}"


def _counted(ends: dict[Path, "Trajectory"], format_: "TrajectoryFormat") -> str:
    """Say which file has no times, where the other one has them; empty where both are alike."""
    from gtf_tune.trajectory.files import detected_format

    kinds = {path: detected_format(path) if format_ == "auto" else format_ for path in ends}
    without = [path for path, kind in kinds.items() if kind in _COUNTED]
    if len(without) != 1:
        return ""
    return f"{without[0]} is {_COUNTED[kinds[without[0]]]}; give it with the times of the other file, as TUM does"


def _other_unit(ends: dict[Path, "Trajectory"]) -> str:
    """Say whose times seem to be in a smaller unit than seconds; empty where none do."""
    spans = {path: float(one.timestamps[-1] - one.timestamps[0]) for path, one in ends.items()}
    small, large = sorted(spans, key=spans.__getitem__)
    ratio = math.log10(spans[large] / spans[small])
    power = 3 * round(ratio / 3)
    if power not in _UNITS or abs(ratio - power) > _SURE:
        return ""
    return f"those of {large} look like {_UNITS[power]}: divide them by 1e{power}"


def _other_clock(ends: dict[Path, "Trajectory"], max_difference_s: float) -> str:
    import numpy as np

    (earlier, first), (later, second) = sorted(ends.items(), key=lambda one: float(one[1].timestamps[0]))
    gap = float(second.timestamps[0] - first.timestamps[-1])
    if gap > max_difference_s:
        return f"{later} begins {gap:.6g} s after the end of {earlier}: give both by the same clock"
    after = np.searchsorted(first.timestamps, second.timestamps)
    around = first.timestamps[np.clip([after - 1, after], 0, len(first) - 1)]
    nearest = float(np.abs(around - second.timestamps).min())
    return f"the nearest two are {nearest:.3g} s apart: raise --max-difference, or give both by the same clock"


def _time(trajectory: "Trajectory", index: int) -> str:
    return f"{trajectory.timestamps[index]:.12g}"
