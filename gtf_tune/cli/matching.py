"""Match the poses of two trajectory files, and explain in their terms where too few belong together."""

import math
from dataclasses import dataclass
from pathlib import Path
from types import MappingProxyType
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from gtf_tune.errors import TrajectoryError
    from gtf_tune.trajectory import Association, Trajectory, TrajectoryFormat

_NO_TIMES = "which holds no times, only image names"
_KINDS = MappingProxyType(
    {
        "kitti": "a KITTI file",
        "colmap": "a COLMAP model",
        "transforms": "a transforms.json",
        "opensfm": "a reconstruction of OpenSfM",
        "sfmdata": "a reconstruction of AliceVision",
    }
)
_WITHOUT_TIMES = MappingProxyType(
    {
        "kitti": "a KITTI file, which holds no times, only lines",
        **{kind: f"{_KINDS[kind]}, {_NO_TIMES}" for kind in ("colmap", "transforms", "opensfm", "sfmdata")},
    }
)
_UNITS = MappingProxyType({3: "milliseconds", 6: "microseconds", 9: "nanoseconds"})
_SURE = 0.5
"""How far the logarithm of a ratio of durations may be from that of two units."""


@dataclass(frozen=True)
class Matching:
    """How two trajectory files are read and their poses associated.

    ``offset_s`` is added to the times of the second file; ``delimiter`` is found by itself where it is ``None``.
    """

    format: "TrajectoryFormat" = "auto"
    max_difference_s: float = 0.02
    offset_s: float = 0.0
    delimiter: str | None = None


def matched_files(reference: Path, estimate: Path, matching: Matching) -> tuple["Trajectory", "Trajectory"]:
    """Return both trajectories with equal frame ids where their image names, times or frame numbers agree.

    Raises
    ------
    TrajectoryError
        A file cannot be read, nothing says which poses belong together, or fewer than 4 do; the message says by what
        they were matched, and what to change.
    """
    from gtf_tune.errors import TrajectoryError
    from gtf_tune.trajectory import associate, matched, read_trajectory
    from gtf_tune.trajectory.alignment import MIN_MATCHED

    first, second = (read_trajectory(path, matching.format, matching.delimiter) for path in (reference, estimate))
    ends = {reference: first, estimate: second}
    association = _association(ends, matching)
    found = associate(first, second, association, matching.max_difference_s, matching.offset_s)
    count = len(found[0])
    if count >= MIN_MATCHED:
        return matched(first, second, found)
    short = [f"{path} holds only {len(poses)}" for path, poses in ends.items() if len(poses) < MIN_MATCHED]
    if short:
        reason = f"{' and '.join(short)}; give longer trajectories"
    else:
        reason = _about_names(ends) if association == "name" else _about_times(ends, matching)
    raise TrajectoryError(
        f"expected at least {MIN_MATCHED} poses that {reference} and {estimate} share, not {count}: {reason}"
    )


def _association(ends: dict[Path, "Trajectory"], matching: Matching) -> "Association":
    """Return by what the poses of two files are associated.

    Raises
    ------
    TrajectoryError
        One file has times and the other none, neither says which frames it has, or an offset is given without times.
    """
    from gtf_tune.errors import TrajectoryError
    from gtf_tune.trajectory import association_of

    try:
        association = association_of(list(ends.values()))
    except TrajectoryError as error:
        raise _incomparable(ends, matching) from error
    if not math.isfinite(matching.offset_s):
        raise TrajectoryError(f"expected a number of seconds as --offset, not {matching.offset_s}")
    if matching.offset_s and association != "timestamp":
        raise TrajectoryError("--offset shifts times, but these poses are matched without times; leave it out")
    return association


def _incomparable(ends: dict[Path, "Trajectory"], matching: Matching) -> "TrajectoryError":
    from gtf_tune.errors import TrajectoryError
    from gtf_tune.trajectory.files import detected_format

    kinds = {path: detected_format(path) if matching.format == "auto" else matching.format for path in ends}
    without = [path for path, poses in ends.items() if not poses.has_timestamps]
    if len(without) == 1:
        return TrajectoryError(
            f"{without[0]} is {_WITHOUT_TIMES[kinds[without[0]]]}, so nothing says which of its poses belong to which "
            "of the other file; give it with the times of the other file, as TUM does"
        )
    shown = " and ".join(f"{path}, {_KINDS[kinds[path]]}, has {len(poses)} poses" for path, poses in ends.items())
    return TrajectoryError(
        f"{shown}: without times they can only be matched in order, where both have a pose of every frame; give files "
        "with times, as TUM has"
    )


def _about_names(ends: dict[Path, "Trajectory"]) -> str:
    shown = " and ".join(f"'{poses.names[0]}' to '{poses.names[-1]}' in {path}" for path, poses in ends.items())
    return f"they were matched by image names, {shown}; give models of the same images under the same names"


def _about_times(ends: dict[Path, "Trajectory"], matching: Matching) -> str:
    shown = " and ".join(f"{_time(poses, 0)} to {_time(poses, -1)} s in {path}" for path, poses in ends.items())
    shift = f" after --offset {matching.offset_s:g} s" if matching.offset_s else ""
    by = f"they were matched by timestamps within --max-difference {matching.max_difference_s:g} s{shift}, {shown}"
    return f"{by}; {_other_unit(ends) or _other_clock(ends, matching)}"


def _other_unit(ends: dict[Path, "Trajectory"]) -> str:
    """Say whose times seem to be in a smaller unit than seconds; empty where none do."""
    spans = {path: float(poses.timestamps[-1] - poses.timestamps[0]) for path, poses in ends.items()}
    small, large = sorted(spans, key=spans.__getitem__)
    ratio = math.log10(spans[large] / spans[small])
    power = 3 * round(ratio / 3)
    if power not in _UNITS or abs(ratio - power) > _SURE:
        return ""
    return f"those of {large} look like {_UNITS[power]}: divide them by 1e{power}"


def _other_clock(ends: dict[Path, "Trajectory"], matching: Matching) -> str:
    import numpy as np

    (_, reference), (moved, estimate) = ends.items()
    shifted = {path: poses.timestamps + matching.offset_s * (path == moved) for path, poses in ends.items()}
    (earlier, first), (later, second) = sorted(shifted.items(), key=lambda end: float(end[1][0]))
    gap = float(second[0] - first[-1])
    if gap > matching.max_difference_s:
        shift = float(reference.timestamps[0] - estimate.timestamps[0])
        return (
            f"{later} begins {gap:.6g} s after the end of {earlier}: give both by the same clock, or the difference of "
            f"the clocks as --offset ({shift:.12g} if both begin at once)"
        )
    after = np.searchsorted(first, second)
    around = first[np.clip([after - 1, after], 0, len(first) - 1)]
    nearest = float(np.abs(around - second).min())
    return f"the nearest two are {nearest:.3g} s apart: raise --max-difference, or give both by the same clock"


def _time(trajectory: "Trajectory", index: int) -> str:
    return f"{trajectory.timestamps[index]:.12g}"
