"""Draw where the time of a study went."""

from collections.abc import Sequence

import plotly.graph_objects as go

from gtf_tune.display import duration, share
from gtf_tune.report.figures import theme
from gtf_tune.report.figures.hover import shortened
from gtf_tune.report.tables.costs import StageCost
from gtf_tune.report.tables.timeline import TimelineBar, lane_counts

_LANE_PX = 26
_SURROUNDINGS_PX = 100
_MOST_HEIGHT_PX = 900
_HOUR_S = 3600.0
_MINUTE_S = 60.0
_STAGE_COLOURS = (
    theme.NOMINAL,
    theme.GROUND_TRUTH,
    theme.REPROJECTION,
    theme.GTF,
    "rgb(120,144,156)",
    "rgb(214,173,47)",
    "rgb(96,125,190)",
    "rgb(200,200,200)",
)
_RUN_COLOURS = {"clean": theme.NOMINAL, "noisy": theme.GTF, "failed": theme.WRONG}


def stage_figure(stages: Sequence[StageCost]) -> go.Figure:
    """Return the time of all runs as one bar, stage by stage."""
    drawn = theme.figure(height=170)
    for number, stage in enumerate(stages):
        drawn.add_bar(
            x=[100 * stage.share],
            y=["time"],
            orientation="h",
            name=stage.stage,
            marker={"color": _STAGE_COLOURS[number % len(_STAGE_COLOURS)], "line": {"color": "white", "width": 1}},
            text=[stage.stage if stage.share > 0.07 else ""],
            textposition="inside",
            insidetextanchor="middle",
            hovertext=[f"{stage.stage}: {duration(stage.total_s)}, {share(stage.share)}"],
            hoverinfo="text",
        )
    drawn.update_layout(
        barmode="stack",
        margin={"t": 40, "b": 45},
        legend={"traceorder": "normal"},
        xaxis=theme.axis("share of the time of all runs [%]", range=[0, 100], showgrid=False),
        yaxis={"visible": False},
    )
    return drawn


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


def _kind(bar: TimelineBar) -> str:
    return "failed" if bar.status == "failed" else bar.kind


def _text(bar: TimelineBar) -> str:
    state = " (failed)" if bar.status == "failed" else ""
    return f"trial {bar.ordinal}, {bar.kind} run {bar.index} of {bar.sequence}{state}<br>{duration(bar.wall_s)}"
