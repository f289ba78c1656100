"""Whether the score and the reprojection error rank trials as ground truth does."""

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
import plotly.graph_objects as go
from scipy import stats

from gtf_tune.display import significant
from gtf_tune.gtf import Aggregate, aggregate_matrix
from gtf_tune.report.drawing import markup, theme
from gtf_tune.report.panels.base import Block, Drawing, Panel, ReportInput
from gtf_tune.report.points import PointSet, TrialPoint, point_sets, sequence_detail, study_points
from gtf_tune.report.study_data import StudyData
from gtf_tune.trajectory import FloatArray

_FEWEST = 3
_LOG_FROM_RATIO = 30.0
_DRAWS = 30
_PIXELS = "mean reprojection error [px]"


@dataclass(frozen=True, eq=False)
class Agreement:
    """Two numbers of n trials against each other, with the least-squares line.

    ``r_squared`` is the squared correlation of the values as they are (the paper's figure of merit), ``spearman`` the
    rank correlation; both NaN, like ``slope`` and ``intercept``, where either side is constant. ``is_log``: whether the
    values of x and of y spread so far that the axis should be logarithmic.
    """

    x: FloatArray
    y: FloatArray
    numbers: tuple[int, ...]
    slope: float
    intercept: float
    r_squared: float
    spearman: float
    is_log: tuple[bool, bool]

    def line(self, count: int = 50) -> tuple[FloatArray, FloatArray]:
        """Return points on the regression line over the range of x, evenly spread on the scale of its axis."""
        low, high = float(self.x.min()), float(self.x.max())
        along = np.geomspace(low, high, count) if self.is_log[0] else np.linspace(low, high, count)
        return along, self.intercept + self.slope * along


def agreement(
    points: Sequence[TrialPoint], x: Callable[[TrialPoint], float], y: Callable[[TrialPoint], float]
) -> Agreement | None:
    """Return how two numbers of the feasible trials go together, or None for fewer than three trials with both."""
    chosen = [point for point in points if point.is_scored and math.isfinite(x(point)) and math.isfinite(y(point))]
    if len(chosen) < _FEWEST:
        return None
    xs, ys = np.array([x(point) for point in chosen]), np.array([y(point) for point in chosen])
    slope = intercept = r_squared = spearman = math.nan
    if np.ptp(xs) > 0 and np.ptp(ys) > 0:
        fit = stats.linregress(xs, ys)
        slope, intercept, r_squared = float(fit.slope), float(fit.intercept), float(fit.rvalue) ** 2
        spearman = float(stats.spearmanr(xs, ys).statistic)
    numbers = tuple(point.number for point in chosen)
    return Agreement(xs, ys, numbers, slope, intercept, r_squared, spearman, (_spreads_far(xs), _spreads_far(ys)))


def agreement_figure(found: Agreement, labels: tuple[str, str], colour: str) -> go.Figure:
    """Return a scatter with its regression line; ``labels`` are the titles of the axes."""
    drawn = theme.figure(height=360)
    types = ["log" if is_log else "linear" for is_log in found.is_log]
    drawn.update_layout(
        showlegend=False,
        margin={"t": 34},
        xaxis=theme.axis(labels[0], type=types[0], **({"dtick": 1} if types[0] == "log" else {})),
        yaxis=theme.axis(labels[1], type=types[1], **({"dtick": 1} if types[1] == "log" else {})),
    )
    if math.isfinite(found.slope):
        x, y = found.line()
        seen = [(a, b) for a, b in zip(x, y, strict=True) if b > 0 or not found.is_log[1]]
        drawn.add_scatter(
            x=[a for a, _ in seen],
            y=[b for _, b in seen],
            mode="lines",
            line={"color": theme.FAINT, "width": 1.5, "dash": "dash"},
            hoverinfo="skip",
        )
    drawn.add_scatter(
        x=found.x,
        y=found.y,
        mode="markers",
        marker={
            "color": [theme.NOMINAL if number == 0 else colour for number in found.numbers],
            "size": [11 if number == 0 else 8 for number in found.numbers],
            "line": {"color": theme.PAPER, "width": 1},
        },
        hovertext=[_text(found, index, labels) for index in range(len(found.numbers))],
        hoverinfo="text",
    )
    return drawn


def merit_text(found: Agreement) -> str:
    """Return the figures of merit of an agreement."""
    if not math.isfinite(found.r_squared):
        return f"{len(found.numbers)} trials; one side is constant, so there is no correlation"
    return f"R² {found.r_squared:.2f}, Spearman {found.spearman:.2f} ({len(found.numbers)} trials)"


def agreement_panel(report: ReportInput) -> list[Block]:
    """Return the score and the reprojection error against ground truth and each other; nothing without ground truth."""
    if not report.data.validations:
        return []
    blocks: list[Block] = []
    for points in point_sets(report.data):
        blocks.extend(_agreements(points, is_one_of_several=report.data.has_several_sequences))
    if not report.data.has_several_sequences:
        blocks.extend(_over_noisy_runs(report.data))
    return blocks


def r_squared_by_runs(matrices: Sequence[FloatArray], truth: FloatArray, aggregate: Aggregate) -> list[float]:
    """Return R2 between score and true error for 1, 2, ... noisy runs, by resampling (the paper's figure on k_delta).

    Parameters
    ----------
    matrices
        (k, k_delta) errors of each trial, without gaps.
    truth
        True errors of the trials, (n,).
    """
    available = min(matrix.shape[1] for matrix in matrices)
    generator = np.random.default_rng(0)
    found = []
    for count in range(1, available + 1):
        draws = [generator.permutation(available)[:count] for _ in range(_DRAWS if count < available else 1)]
        scores = [[aggregate_matrix(matrix[:, chosen], aggregate) for matrix in matrices] for chosen in draws]
        squares = [np.corrcoef(drawn, truth)[0, 1] ** 2 for drawn in scores if np.ptp(drawn) > 0]
        found.append(float(np.mean(squares)) if squares else math.nan)
    return found


def _over_noisy_runs(data: StudyData) -> list[Block]:
    """Return the figure of R2 over the number of noisy runs, where enough trials have truth and whole matrices."""
    points = study_points(data)
    known = [
        (sequence_detail(data, point.number, points.title).matrix, point.ground_truth)
        for point in points.scored
        if math.isfinite(point.ground_truth)
    ]
    whole = [(matrix, error) for matrix, error in known if matrix.size and not np.isnan(matrix).any()]
    truth = np.array([error for _, error in whole])
    if len(whole) < _FEWEST or np.ptp(truth) == 0:
        return []
    values = r_squared_by_runs([matrix for matrix, _ in whole], truth, data.definition.gtf.aggregate)
    figure = theme.figure(height=300)
    figure.update_layout(
        showlegend=False,
        xaxis=theme.axis("noisy runs (k_delta)"),
        yaxis=theme.axis("R² with the true error", range=[0, 1.02]),
    )
    counts = list(range(1, len(values) + 1))
    figure.add_scatter(x=counts, y=values, mode="lines+markers", line={"color": theme.GTF_DARK})
    return [Drawing("r2 over noisy runs", "R² over the number of noisy runs, resampled from this study", figure)]


def _spreads_far(values: FloatArray) -> bool:
    return bool(values.min() > 0 and values.max() / values.min() > _LOG_FROM_RATIO)


def _text(found: Agreement, index: int, labels: tuple[str, str]) -> str:
    number = found.numbers[index]
    name = "trial 0 (nominal)" if number == 0 else f"trial {number}"
    return "<br>".join(
        [
            f"<b>{name}</b>",
            f"{labels[0]}: {significant(float(found.x[index]), 4)}",
            f"{labels[1]}: {significant(float(found.y[index]), 4)}",
        ]
    )


def _agreements(points: PointSet, *, is_one_of_several: bool) -> list[Block]:
    pairs = (
        ("GTF vs ground truth", _value, _truth, (points.unit.label, points.truth_label), theme.GTF),
        (
            "Reprojection error vs ground truth",
            _reprojection,
            _truth,
            (_PIXELS, points.truth_label),
            theme.REPROJECTION,
        ),
        ("GTF vs reprojection error", _value, _reprojection, (points.unit.label, _PIXELS), theme.REPROJECTION),
    )
    blocks: list[Block] = []
    for title, x, y, labels, colour in pairs:
        known = [point for point in points.scored if math.isfinite(x(point)) and math.isfinite(y(point))]
        found = agreement(known, x, y)
        if found is not None:
            name = f"{title} ({points.title})"
            shown = f"{title}: {merit_text(found)}" + (f" ({points.title})" if is_one_of_several else "")
            blocks.append(Drawing(name.lower(), shown, agreement_figure(found, labels, colour)))
        elif known or (x is not _truth and y is not _truth):
            blocks.append(markup.missing(f"{title}: {len(known)} trials have both numbers, and it takes three."))
    return blocks


def _value(point: TrialPoint) -> float:
    return point.value


def _truth(point: TrialPoint) -> float:
    return point.ground_truth


def _reprojection(point: TrialPoint) -> float:
    return point.reprojection_px


PANEL = Panel(
    "Does the score tell the truth?",
    agreement_panel,
    "One point per feasible trial. A good score orders the trials as their true errors do (Spearman near 1).",
)
