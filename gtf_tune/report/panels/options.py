"""The score over each option, ground truth beside it (the paper's figure)."""

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import plotly.graph_objects as go

from gtf_tune.display import significant, value_text
from gtf_tune.report.drawing import markup, theme
from gtf_tune.report.drawing.axes import (
    OptionAxis,
    option_axis_layout,
    rim_axis_layout,
    score_axis_layout,
    searched_axes,
    trial_text,
    truth_axis_layout,
)
from gtf_tune.report.panels.base import Block, Drawing, Panel, ReportInput
from gtf_tune.report.points import PointSet, TrialPoint, point_sets
from gtf_tune.report.study_data import StudyData
from gtf_tune.study.outcome.verdict import ADOPT, KEEP

_MOST_LEVELS = 25
_LINE_PX = 2.5
_RIM = 0.975
_MANY = 80
_GOLDEN = 0.618034
_SPREAD = 0.16
_BESIDE = 0.12
_MOST_FIGURES = 40


@dataclass(frozen=True)
class Star:
    """The trial that figures mark as the best, and what to call it."""

    number: int
    name: str


@dataclass(frozen=True)
class OptionCurve:
    """The trials over one option, sorted along its axis.

    ``line`` are the points to connect: all of them where only this option is searched, the best at each level where
    there are few levels, otherwise none, because the other options vary between neighbours. ``stopped`` are trials
    that were pruned with a score, ``outside`` those without any, each with its place. ``star`` is the trial to mark.
    """

    axis: OptionAxis
    points: tuple[TrialPoint, ...]
    places: tuple[float, ...]
    line: tuple[int, ...]
    stopped: tuple[tuple[float, TrialPoint], ...]
    outside: tuple[tuple[float, TrialPoint], ...]
    is_alone: bool
    star: Star | None = None

    @property
    def nominal(self) -> int | None:
        """Return the index of the nominal trial."""
        return self._index(0)

    @property
    def best(self) -> int | None:
        """Return the index of the trial to mark; None where there is none or it has no score here."""
        return None if self.star is None else self._index(self.star.number)

    @property
    def best_ground_truth(self) -> int | None:
        """Return the index of the smallest error against ground truth."""
        return _index_of_least([point.ground_truth for point in self.points])

    def _index(self, number: int) -> int | None:
        return next((index for index, point in enumerate(self.points) if point.number == number), None)


def option_curve(points: PointSet, axis: OptionAxis, searched: int, star: Star | None = None) -> OptionCurve:
    """Return the trials over one option; ``searched`` is how many options the study varies, ``star`` the best trial."""
    placed = [
        (axis.place(point.options[axis.option]), point) for point in points.points if axis.option in point.options
    ]
    scored = sorted(((x, point) for x, point in placed if point.is_scored), key=lambda pair: (pair[0], pair[1].number))
    places = tuple(x for x, _ in scored)
    is_alone = searched == 1
    return OptionCurve(
        axis=axis,
        points=tuple(point for _, point in scored),
        places=places,
        line=(
            tuple(range(len(scored))) if is_alone else _best_of_each_level(places, [point.value for _, point in scored])
        ),
        stopped=tuple((x, point) for x, point in placed if point.state == "pruned" and math.isfinite(point.value)),
        outside=tuple((x, point) for x, point in placed if point.has_ended and math.isnan(point.value)),
        is_alone=is_alone,
        star=star,
    )


def recommended_star(data: StudyData) -> Star | None:
    """Return the mark of the trial to use; None where no trial is recommended."""
    found = data.recommendation
    name = {ADOPT: "adopted", KEEP: "kept"}.get(found.decision, "best so far")
    return Star(found.trial.number, name) if found.trial and found.trial.number >= 0 else None


def option_figure(curve: OptionCurve, points: PointSet) -> go.Figure:
    """Return the figure of one option: score with interval in pink, ground truth in green, nominal in blue."""
    drawn = theme.figure(
        height=430,
        margin={"l": 60, "r": 75 if points.has_ground_truth else 30, "t": 34, "b": 120},
        legend={"y": -0.3, "yanchor": "top", "traceorder": "normal"},
        xaxis=option_axis_layout(curve.axis),
        yaxis=score_axis_layout(curve.points, points),
    )
    canvas = _Canvas(drawn, curve, points)
    if points.has_ground_truth:
        drawn.update_layout(yaxis2=truth_axis_layout(curve.points, points))
        canvas.add_ground_truth()
    canvas.add_interval()
    canvas.add_scores()
    canvas.add_stopped()
    canvas.add_nominal()
    canvas.add_stars()
    canvas.add_outside()
    return drawn


def options_panel(report: ReportInput) -> list[Block]:
    """Return the paper's figure for each option, over all sequences and for each of them."""
    data = report.data
    if not data.feasible:
        return [markup.missing("No trial is feasible and complete yet, so there is no score to show.")]
    scopes = point_sets(data)
    drawings: list[Block] = [
        Drawing(f"option {axis.option} {points.title}", _option_title(data, axis, points), _draw(data, axis, points))
        for axis in searched_axes(data)
        for points in scopes
    ]
    if len(drawings) <= _MOST_FIGURES:
        return drawings
    note = f"Only {_MOST_FIGURES} of {len(drawings)} figures are shown: the study has many options and sequences."
    return [markup.missing(note), *drawings[:_MOST_FIGURES]]


def _best_of_each_level(places: Sequence[float], values: Sequence[float]) -> tuple[int, ...]:
    best: dict[float, int] = {}
    for index, (place, value) in enumerate(zip(places, values, strict=True)):
        if place not in best or value < values[best[place]]:
            best[place] = index
    few = len(best) <= min(_MOST_LEVELS, len(places) // 2)
    return tuple(best[place] for place in sorted(best)) if few else ()


def _index_of_least(values: Sequence[float]) -> int | None:
    known = [(value, index) for index, value in enumerate(values) if math.isfinite(value)]
    return min(known)[1] if known else None


@dataclass(frozen=True, eq=False)
class _Canvas:
    drawn: go.Figure
    curve: OptionCurve
    points: PointSet

    @property
    def has_categories(self) -> bool:
        return self.curve.axis.scale == "categories"

    @property
    def is_crowded(self) -> bool:
        return len(self.curve.points) > _MANY

    @property
    def _truth_name(self) -> str:
        return self.points.truth_name.replace("ground-truth", "true")

    def add_ground_truth(self) -> None:
        self._add_line(_truth, theme.GROUND_TRUTH, "y2")
        size, opacity = 4 if self.is_crowded else 7, 1.0 if self.curve.is_alone else 0.5
        marker = {"color": theme.GROUND_TRUTH, "symbol": "diamond", "size": size, "opacity": opacity}
        self._add_marks(self._beside(_BESIDE), _truth, "y2", name=self._truth_name, marker=marker)

    def add_interval(self) -> None:
        """Add the intervals as a band where neighbours may be connected; elsewhere they are error bars."""
        if not self.curve.is_alone or self.has_categories:
            return
        band = {"x": list(self.curve.places), "line": {"width": 0}, "hoverinfo": "skip", "mode": "lines"}
        self.drawn.add_scatter(**band, y=[_high(point) for point in self.curve.points], showlegend=False)
        low = [_low(point) for point in self.curve.points]
        self.drawn.add_scatter(**band, y=low, fill="tonexty", fillcolor=theme.GTF_BAND, name="95 % interval")

    def add_scores(self) -> None:
        self._add_line(_score, theme.GTF, "y")
        bars = None
        if not self.is_crowded and (self.has_categories or not self.curve.is_alone):
            up = [_high(point) - point.value for point in self.curve.points]
            down = [point.value - _low(point) for point in self.curve.points]
            bars = {"array": up, "arrayminus": down, "color": theme.GTF, "thickness": 0.8, "width": 0}
        marker = {"color": theme.GTF, "size": 6 if self.is_crowded else 8, "line": {"color": theme.PAPER, "width": 1}}
        places, name = self._beside(-_BESIDE), self.points.unit.name
        self._add_marks(places, _score, "y", name=name, marker=marker, error_y=bars)

    def add_stopped(self) -> None:
        marker = {"color": theme.REPROJECTION, "size": 9, "symbol": "triangle-down"}
        self._add_trials(self.curve.stopped, _score, name="stopped early", marker=marker)

    def add_nominal(self) -> None:
        index = self.curve.nominal
        if index is None:
            return
        place, point = self.curve.places[index], self.curve.points[index]
        self.drawn.add_vline(x=place, line={"color": theme.NOMINAL, "width": 1.5, "dash": "dash"})
        marker = {"color": theme.NOMINAL, "size": 11, "line": {"color": theme.PAPER, "width": 1.5}}
        self._add_trials([(place, point)], _score, name=f"nominal: {self._value_at(index)}", marker=marker)

    def add_stars(self) -> None:
        # Above the other and smaller, because often both are the same trial.
        name = self.curve.star.name if self.curve.star else ""
        self._add_star(self.curve.best, _score, "y", name, {"color": theme.GTF, "size": 13})
        if self.points.has_ground_truth:
            style = {"color": theme.GROUND_TRUTH, "size": 22}
            self._add_star(self.curve.best_ground_truth, _truth, "y2", f"least {self._truth_name}", style)

    def add_outside(self) -> None:
        """Mark trials without a score at the upper rim, where no value is claimed for them."""
        if self.curve.outside:
            self.drawn.update_layout(yaxis3=rim_axis_layout(self.points))
            line = {"color": theme.WRONG, "width": 2}
            marker = {"color": theme.WRONG, "size": 9, "symbol": "x-thin", "line": line}
            self._add_trials(self.curve.outside, lambda _: _RIM, "y3", name="no value", marker=marker)

    def _add_line(self, number: Callable[[TrialPoint], float], colour: str, axis: str) -> None:
        if self.curve.line and not self.has_categories:
            self.drawn.add_scatter(
                x=[self.curve.places[index] for index in self.curve.line],
                y=[number(self.curve.points[index]) for index in self.curve.line],
                yaxis=axis,
                mode="lines",
                line={"color": colour, "width": _LINE_PX},
                hoverinfo="skip",
                showlegend=False,
            )

    def _add_star(
        self, index: int | None, number: Callable[[TrialPoint], float], axis: str, name: str, style: dict[str, Any]
    ) -> None:
        if index is not None:
            marker = {**style, "symbol": "star", "line": {"color": theme.INK, "width": 1}}
            found = [(self.curve.places[index], self.curve.points[index])]
            self._add_trials(found, number, axis, name=f"{name}: {self._value_at(index)}", marker=marker)

    def _add_marks(
        self, places: Sequence[float], number: Callable[[TrialPoint], float], axis: str, **style: Any
    ) -> None:
        self._add_trials(list(zip(places, self.curve.points, strict=True)), number, axis, **style)

    def _add_trials(
        self,
        placed: Sequence[tuple[float, TrialPoint]],
        number: Callable[[TrialPoint], float],
        axis: str = "y",
        **style: Any,
    ) -> None:
        if placed:
            self.drawn.add_scatter(
                x=[place for place, _ in placed],
                y=[number(point) for _, point in placed],
                yaxis=axis,
                mode="markers",
                hovertext=[trial_text(point, self.points) for _, point in placed],
                hoverinfo="text",
                **style,
            )

    def _beside(self, offset: float) -> list[float]:
        """Return the places of the points; those of a category spread beside it, the same way every time."""
        if not self.has_categories:
            return list(self.curve.places)
        return [
            place + offset + _SPREAD * (point.number * _GOLDEN % 1 - 0.5)
            for place, point in zip(self.curve.places, self.curve.points, strict=True)
        ]

    def _value_at(self, index: int) -> str:
        value = self.curve.points[index].options[self.curve.axis.option]
        return significant(value) if isinstance(value, float) else value_text(value)


def _score(point: TrialPoint) -> float:
    return point.value


def _truth(point: TrialPoint) -> float:
    return point.ground_truth


def _low(point: TrialPoint) -> float:
    return point.value if math.isnan(point.low) else point.low


def _high(point: TrialPoint) -> float:
    return point.value if math.isnan(point.high) else point.high


def _option_title(data: StudyData, axis: OptionAxis, points: PointSet) -> str:
    return f"{axis.option} ({points.title})" if data.has_several_sequences else axis.option


def _draw(data: StudyData, axis: OptionAxis, points: PointSet) -> object:
    curve = option_curve(points, axis, len(data.definition.space), recommended_star(data))
    return option_figure(curve, points)


def _lead(data: StudyData) -> str:
    green = " Green: the error against ground truth, which the search never sees." if data.validations else ""
    return (
        f"Pink: the score without ground truth, with its 95 % interval.{green} Blue: the nominal options. "
        "Star: the trial to use."
    )


PANEL = Panel("Score over each option", options_panel, _lead)
