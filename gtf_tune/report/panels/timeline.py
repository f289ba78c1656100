"""Which machine made which run, and when."""

from collections.abc import Sequence
from dataclasses import dataclass

import plotly.graph_objects as go

from gtf_tune.display import duration
from gtf_tune.report.drawing import markup, theme
from gtf_tune.report.drawing.axes import shortened
from gtf_tune.report.panels.base import Block, Drawing, Panel, ReportInput
from gtf_tune.report.study_data import runs_made
from gtf_tune.store.runs import TrialRun

_UNKNOWN_HOST = "unknown machine"
_LANE_PX = 26
_SURROUNDINGS_PX = 100
_MOST_HEIGHT_PX = 900
_HOUR_S = 3600.0
_MINUTE_S = 60.0
_RUN_COLOURS = {"clean": theme.NOMINAL, "noisy": theme.GTF, "failed": theme.WRONG}


@dataclass(frozen=True)
class TimelineBar:
    """One run on the timeline: seconds since the first run began, and a lane of its machine.

    Runs that overlapped on one machine lie in different lanes, counted from 0.
    """

    host: str
    lane: int
    start_s: float
    wall_s: float
    number: int
    kind: str
    index: int
    sequence: str
    status: str


def timeline(runs: Sequence[TrialRun]) -> tuple[TimelineBar, ...]:
    """Return a bar for each run, by machine and start."""
    timed = sorted((use for use in runs if use.run.started_at > 0), key=lambda use: use.run.started_at)
    if not timed:
        return ()
    begin = timed[0].run.started_at
    free_at: dict[str, list[float]] = {}
    bars = [_bar(use, begin, free_at.setdefault(use.run.host or _UNKNOWN_HOST, [])) for use in timed]
    return tuple(sorted(bars, key=lambda bar: (bar.host, bar.start_s)))


def lane_counts(bars: Sequence[TimelineBar]) -> dict[str, int]:
    """Return how many lanes each machine has."""
    counts: dict[str, int] = {}
    for bar in bars:
        counts[bar.host] = max(counts.get(bar.host, 0), bar.lane + 1)
    return counts


def timeline_figure(bars: Sequence[TimelineBar]) -> go.Figure:
    """Return the runs over time, one group of lanes for each machine."""
    lanes = lane_counts(bars)
    offsets, rows = {}, 0
    for host, count in lanes.items():
        offsets[host] = rows
        rows += count
    last_s = max(bar.start_s + bar.wall_s for bar in bars)
    unit_s, unit = (_HOUR_S, "h") if last_s > 2 * _HOUR_S else (_MINUTE_S, "min") if last_s > 120 else (1.0, "s")
    height = min(_SURROUNDINGS_PX + _LANE_PX * max(rows, 3), _MOST_HEIGHT_PX)
    drawn = theme.figure(height=height)
    for kind, colour in _RUN_COLOURS.items():
        chosen = [bar for bar in bars if _kind(bar) == kind]
        drawn.add_bar(
            base=[bar.start_s / unit_s for bar in chosen],
            x=[bar.wall_s / unit_s for bar in chosen],
            y=[offsets[bar.host] + bar.lane for bar in chosen],
            orientation="h",
            width=0.8,
            name=kind,
            marker={"color": colour, "line": {"width": 0}},
            hovertext=[_text(bar) for bar in chosen],
            hoverinfo="text",
        )
    drawn.update_layout(
        barmode="overlay",
        bargap=0,
        xaxis=theme.axis(f"time since the first run [{unit}]"),
        yaxis=theme.axis(
            "",
            tickvals=[offsets[host] + (count - 1) / 2 for host, count in lanes.items()],
            ticktext=[shortened(host, 24) for host in lanes],
            range=[rows - 0.4, -0.6],
            showgrid=False,
        ),
    )
    return drawn


def timeline_panel(report: ReportInput) -> list[Block]:
    """Return the runs over time by machine."""
    bars = timeline(runs_made(report.data.runs))
    if not bars:
        return [markup.missing("No run has a start time, so there is no timeline.")]
    return [Drawing("timeline", "", timeline_figure(bars), is_wide=True)]


def _bar(use: TrialRun, begin: float, free_at: list[float]) -> TimelineBar:
    run = use.run
    start_s = run.started_at - begin
    lane = next((index for index, free in enumerate(free_at) if free <= start_s), len(free_at))
    if lane == len(free_at):
        free_at.append(0.0)
    free_at[lane] = start_s + run.wall_s
    host = run.host or _UNKNOWN_HOST
    return TimelineBar(host, lane, start_s, run.wall_s, use.number, run.kind, run.index, use.sequence_name, run.status)


def _kind(bar: TimelineBar) -> str:
    return "failed" if bar.status == "failed" else bar.kind


def _text(bar: TimelineBar) -> str:
    state = " (failed)" if bar.status == "failed" else ""
    return f"trial {bar.number}, {bar.kind} run {bar.index} of {bar.sequence}{state}<br>{duration(bar.wall_s)}"


PANEL = Panel("Timeline of runs", timeline_panel)
