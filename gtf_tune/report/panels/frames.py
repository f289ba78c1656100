"""How far each frame moves under noise, and how often it is registered."""

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import plotly.graph_objects as go

from gtf_tune.display import count, significant
from gtf_tune.gtf.random_effects import far_above_median
from gtf_tune.report.aligned_runs import PER_MILLE, ConfigurationRuns, extent, frame_distances
from gtf_tune.report.drawing import markup, theme
from gtf_tune.report.drawing.markup import Html
from gtf_tune.report.panels.base import Block, Drawing, Panel, ReportInput
from gtf_tune.trajectory import BoolArray, FloatArray, IntArray

_LISTED_FRAMES = 8


@dataclass(frozen=True, eq=False)
class FrameSpread:
    """Movement under noise of the n frames that any run of one configuration registered.

    ``median`` (n,) is in per mille of the extent: over all pairs of a clean and a noisy run that both have the frame.
    ``registered`` (n,) is the share of all runs that have the frame, ``fragile`` (n,) marks frames far above the median
    of their sequence.
    """

    title: str
    frame_ids: IntArray
    median: FloatArray
    registered: FloatArray
    fragile: BoolArray


def frame_spread(runs: ConfigurationRuns) -> FrameSpread:
    """Return how far each frame moves between clean and noisy runs."""
    every_run = [*runs.clean, *runs.noisy]
    frame_ids = np.unique(np.concatenate([run.frame_ids for run in every_run])) if every_run else np.empty(0, np.int64)
    extent_ = extent(runs.reference) if runs.reference is not None else math.nan
    distances = frame_distances(runs.clean, runs.noisy, frame_ids, runs.alignment)
    pairs = len(runs.clean) * len(runs.noisy)  # given, as -1 cannot be worked out where no run has a frame
    median = PER_MILLE * _median(distances.reshape(pairs, len(frame_ids))) / extent_
    present = np.array([np.isin(frame_ids, run.frame_ids) for run in every_run], dtype=np.float64)
    registered = present.mean(axis=0) if every_run else np.empty(0)
    return FrameSpread(runs.title, frame_ids, median, registered, far_above_median(median))


def spread_figure(spreads: Sequence[tuple[FrameSpread, str]]) -> go.Figure:
    """Return how far frames move and how often they are registered, a colour for each configuration."""
    drawn = theme.figure(height=420)
    for spread, colour in spreads:
        hover = [_frame_text(spread, index) for index in range(len(spread.frame_ids))]
        words = {"hovertext": hover, "hoverinfo": "text"}
        drawn.add_scatter(
            x=spread.frame_ids, y=spread.median, mode="lines", name=spread.title, line={"color": colour}, **words
        )
        drawn.add_scatter(
            x=spread.frame_ids[spread.fragile],
            y=spread.median[spread.fragile],
            mode="markers",
            name=f"fragile ({spread.title})",
            marker={"color": colour, "size": 10, "symbol": "circle-open", "line": {"width": 2}},
            showlegend=bool(spread.fragile.any()),
            hovertext=[hover[index] for index in np.flatnonzero(spread.fragile)],
            hoverinfo="text",
        )
        drawn.add_scatter(
            x=spread.frame_ids, y=100 * spread.registered, yaxis="y2", mode="lines", showlegend=False, **words
        ).data[-1].update(line={"color": colour, "shape": "hvh"})
    drawn.update_layout(
        xaxis=theme.axis("frame", anchor="y2"),
        yaxis=theme.axis("moved by [‰ of extent]", domain=[0.36, 1], rangemode="tozero"),
        yaxis2=theme.axis("registered [%]", domain=[0, 0.24], range=[-5, 105], tickvals=[0, 50, 100]),
    )
    return drawn


def frames_panel(report: ReportInput) -> list[Block]:
    """Return how far each frame moves and how often it is registered, and name the fragile ones."""
    blocks: list[Block] = []
    colours = (theme.NOMINAL, theme.GTF_DARK)
    for sequence, configurations in report.configurations.items():
        spreads = [frame_spread(runs) for runs in configurations]
        if not any(np.isfinite(spread.median).any() for spread in spreads):
            blocks.append(markup.missing(f"{sequence}: no noisy run can be compared with a clean one."))
            continue
        drawn = spread_figure(list(zip(spreads, colours, strict=False)))
        blocks.append(Drawing(f"frames {sequence}", sequence, drawn, is_wide=True))
        for spread, runs in zip(spreads, configurations, strict=True):
            blocks.append(_fragile_text(spread, sequence, runs.num_frames))
    return blocks or [markup.missing("No run has finished yet, so nothing is known about single frames.")]


def _median(distances: FloatArray) -> FloatArray:
    """Return the median over the first axis of (m, n), leaving out NaN; NaN where nothing is left."""
    result = np.full(distances.shape[1], np.nan)
    known = np.isfinite(distances).any(axis=0)
    if known.any():
        result[known] = np.nanmedian(distances[:, known], axis=0)
    return result


def _frame_text(spread: FrameSpread, index: int) -> str:
    return (
        f"{spread.title}, frame {spread.frame_ids[index]}<br>moved by {significant(float(spread.median[index]))} ‰ of "
        f"extent<br>registered in {100 * spread.registered[index]:.0f} % of the runs"
    )


def _fragile_text(spread: FrameSpread, sequence: str, num_frames: int) -> Html:
    fragile = np.flatnonzero(spread.fragile)
    order = fragile[np.argsort(-spread.median[fragile])]
    named = ", ".join(
        f"{spread.frame_ids[index]} ({significant(float(spread.median[index]))} ‰)" for index in order[:_LISTED_FRAMES]
    )
    more = f" and {len(order) - _LISTED_FRAMES} more" if len(order) > _LISTED_FRAMES else ""
    moved = f"these frames move far more than others: {named}{more}" if named else "no frame moves far more than others"
    partly = int((spread.registered < 1).sum())
    never = num_frames - len(spread.frame_ids)
    registered = (
        f"{count(partly, 'frame')} registered in some runs only, {count(never, 'frame')} in none"
        if partly or never
        else "every run registered every frame"
    )
    return markup.paragraph(f"{sequence}, {spread.title}: {moved}; {registered}.")


PANEL = Panel(
    "Fragile frames",
    frames_panel,
    ("How far each frame moves under noise: the median over all pairs of runs."),
)
