"""Say which run was made where and when."""

from collections.abc import Sequence
from dataclasses import dataclass

from gtf_tune.store.runs import TrialRun

_UNKNOWN_HOST = "unknown machine"


@dataclass(frozen=True)
class TimelineBar:
    """Hold one run on the timeline: seconds since the first run began, and the lane of its machine.

    Runs that overlapped on one machine lie in different lanes, counted from 0.
    """

    host: str
    lane: int
    start_s: float
    wall_s: float
    ordinal: int
    kind: str
    index: int
    sequence: str
    status: str


def timeline(runs: Sequence[TrialRun]) -> tuple[TimelineBar, ...]:
    """Return a bar for each run, by machine and start."""
    timed = sorted((one for one in runs if one.run.started_at > 0), key=lambda one: one.run.started_at)
    if not timed:
        return ()
    begin = timed[0].run.started_at
    free_at: dict[str, list[float]] = {}
    bars = [_bar(one, begin, free_at.setdefault(one.run.host or _UNKNOWN_HOST, [])) for one in timed]
    return tuple(sorted(bars, key=lambda bar: (bar.host, bar.start_s)))


def lane_counts(bars: Sequence[TimelineBar]) -> dict[str, int]:
    """Return how many lanes each machine has."""
    counts: dict[str, int] = {}
    for bar in bars:
        counts[bar.host] = max(counts.get(bar.host, 0), bar.lane + 1)
    return counts


def _bar(one: TrialRun, begin: float, free_at: list[float]) -> TimelineBar:
    run = one.run
    start_s = run.started_at - begin
    lane = next((index for index, free in enumerate(free_at) if free <= start_s), len(free_at))
    if lane == len(free_at):
        free_at.append(0.0)
    free_at[lane] = start_s + run.wall_s
    host = run.host or _UNKNOWN_HOST
    return TimelineBar(host, lane, start_s, run.wall_s, one.ordinal, run.kind, run.index, one.sequence_name, run.status)
