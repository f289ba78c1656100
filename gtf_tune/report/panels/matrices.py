"""The errors between clean and noisy runs."""

import math
from collections.abc import Sequence

import numpy as np
import plotly.graph_objects as go

from gtf_tune.display import ScoreUnit, interval, sequence_unit, significant
from gtf_tune.report.drawing import markup, theme
from gtf_tune.report.drawing.axes import shortened
from gtf_tune.report.panels.base import Block, Drawing, Panel, ReportInput
from gtf_tune.report.panels.verdict import compared_trials
from gtf_tune.report.points import SequenceDetail, sequence_detail

_ROW_PX = 34
_SURROUNDINGS_PX = 160
_MOST_LABELLED = 400


def matrix_range(details: Sequence[SequenceDetail], unit: ScoreUnit) -> tuple[float, float]:
    """Return the smallest and the largest error of several matrices in the shown unit, so that they share colours."""
    values = [float(value) * unit.factor for detail in details for value in detail.matrix.ravel()]
    positive = [value for value in values if value > 0]
    return (min(positive), max(positive)) if positive else (1.0, 1.0)


def matrix_figure(detail: SequenceDetail, unit: ScoreUnit, colours: tuple[float, float]) -> go.Figure:
    """Return the (k, k_delta) matrix as a heat map on a logarithmic colour scale."""
    rows, columns = detail.matrix.shape
    values = detail.matrix * unit.factor
    drawn = theme.figure(height=_SURROUNDINGS_PX + _ROW_PX * max(rows, 2))
    low, high = (math.log10(end) for end in colours)
    ticks = [low, (low + high) / 2, high] if high > low else [low]
    drawn.add_heatmap(
        z=np.log10(np.where(values > 0, values, np.nan)),
        zmin=low,
        zmax=high if high > low else low + 1,
        colorscale=theme.ERROR_SCALE,
        xgap=2,
        ygap=2,
        text=_labels(values),
        texttemplate="%{text}" if rows * columns <= _MOST_LABELLED else None,
        hovertext=[[_hover(detail, values, i, j, unit) for j in range(columns)] for i in range(rows)],
        hoverinfo="text",
        hoverongaps=True,
        colorbar=theme.colour_bar(
            f"error [{unit.symbol}]", tickvals=ticks, ticktext=[significant(10**tick, 2) for tick in ticks]
        ),
    )
    drawn.update_layout(
        xaxis=theme.axis(
            "noisy run",
            tickvals=list(range(columns)),
            ticktext=[f"{j}<br>collapsed" if _flag(detail, j) else str(j) for j in range(columns)],
            showgrid=False,
        ),
        yaxis=theme.axis("clean run", tickvals=list(range(rows)), autorange="reversed", showgrid=False),
        margin={"t": 34, "b": 95},
    )
    return drawn


def matrices_panel(report: ReportInput) -> list[Block]:
    """Return the matrix of errors of each compared trial on each sequence, in common colours."""
    data, unit = report.data, sequence_unit(report.data.definition.gtf)
    compared = compared_trials(data)
    blocks: list[Block] = []
    for sequence in data.sequences:
        found = [(name, number, sequence_detail(data, number, sequence.name)) for name, number in compared]
        colours = matrix_range([detail for _, _, detail in found], unit)
        for name, number, detail in found:
            if not detail.matrix.size:
                reason = detail.message or "it has no noisy runs"
                blocks.append(markup.missing(f"{sequence.name}, {name} trial {number}: no matrix, because {reason}."))
                continue
            title = f"{sequence.name}, {name} (trial {number}): {_score_text(detail, unit)}"
            drawn = matrix_figure(detail, unit, colours)
            blocks.append(Drawing(f"matrix {sequence.name} {name}", title, drawn))
    return blocks or [markup.missing("No trial is complete yet, so there is no matrix to show.")]


def _labels(values: np.ndarray[tuple[int, ...], np.dtype[np.float64]]) -> list[list[str]]:
    return [["failed" if math.isnan(value) else significant(float(value)) for value in row] for row in values]


def _flag(detail: SequenceDetail, column: int) -> bool:
    return column < len(detail.collapsed) and detail.collapsed[column]


def _hover(
    detail: SequenceDetail,
    values: np.ndarray[tuple[int, ...], np.dtype[np.float64]],
    row: int,
    column: int,
    unit: ScoreUnit,
) -> str:
    value = float(values[row, column])
    reason = shortened(detail.pair_errors.get((row, column), "no error could be computed"))
    lines = [
        f"clean run {row}, noisy run {column}",
        f"<b>{significant(value, 4)} {unit.symbol}</b>" if math.isfinite(value) else reason,
    ]
    if _flag(detail, column):
        lines.append("this noisy run collapsed")
    return "<br>".join(lines)


def _score_text(detail: SequenceDetail, unit: ScoreUnit) -> str:
    low, high = unit.shown(detail.low), unit.shown(detail.high)
    sure = f" ({interval(low, high)})" if np.isfinite(low) else ""
    return f"{significant(unit.shown(detail.value))}{sure} {unit.symbol}"


PANEL = Panel(
    "Errors between clean and noisy runs",
    matrices_panel,
    ("Each cell is the error of one noisy run against one clean run; the score aggregates the whole matrix."),
)
