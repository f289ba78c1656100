"""Axes of options and of scores, and what is said of a trial that the pointer is on."""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from html import escape
from typing import Any, Literal

from gtf_tune.definition import Axis, RangeAxis
from gtf_tune.display import interval, share, significant, value_text
from gtf_tune.pipelines import OptionValue
from gtf_tune.report.drawing import theme
from gtf_tune.report.points import PointSet, TrialPoint
from gtf_tune.report.study_data import StudyData

AxisScale = Literal["log", "linear", "categories"]
_OPTION_AXIS_LOG_FROM_RATIO = 10.0


@dataclass(frozen=True)
class OptionAxis:
    """Axis of one option: its scale, its ends, and the words of its categories in order."""

    option: str
    scale: AxisScale
    low: float
    high: float
    categories: tuple[str, ...] = ()

    def place(self, value: OptionValue) -> float:
        """Return where a value lies on the axis: the number itself, or the position of its category."""
        return float(self.categories.index(value_text(value))) if self.scale == "categories" else float(value)


def option_axis(option: str, axis: Axis, seen: Sequence[OptionValue] = ()) -> OptionAxis:
    """Return the axis of an option, logarithmic where the search space is, wide enough for all values seen."""
    if isinstance(axis, RangeAxis):
        numbers = [axis.low, axis.high, *(value for value in seen if isinstance(value, int | float))]
        return OptionAxis(option, "log" if axis.log else "linear", float(min(numbers)), float(max(numbers)))
    values = [*(value for value in dict.fromkeys(seen) if value not in axis.values), *axis.values]
    numbers = [float(value) for value in values if isinstance(value, int | float) and not isinstance(value, bool)]
    if len(numbers) < len(values) or len(numbers) < 2:
        words = tuple(value_text(value) for value in values)
        return OptionAxis(option, "categories", 0.0, float(len(words) - 1), words)
    low, high = min(numbers), max(numbers)
    return OptionAxis(option, "log" if low > 0 and high / low >= _OPTION_AXIS_LOG_FROM_RATIO else "linear", low, high)


def options_at_an_edge(
    space: Mapping[str, Axis], chosen: Mapping[str, OptionValue], nominal: Mapping[str, OptionValue]
) -> tuple[str, ...]:
    """Return the options whose chosen number is an end of its range: a better one may lie beyond.

    One that is nominal is not: nothing was gained on the way to it.
    """
    found = []
    for option, axis in space.items():
        value = chosen.get(option)
        if value == nominal.get(option):
            continue
        if isinstance(axis, RangeAxis) and isinstance(value, int | float) and not isinstance(value, bool):
            near = 1e-6 * (abs(axis.low) + abs(axis.high)) if not axis.log else 1e-6 * abs(value)
            if min(abs(value - axis.low), abs(value - axis.high)) <= near:
                found.append(option)
    return tuple(found)


def searched_axes(data: StudyData) -> tuple[OptionAxis, ...]:
    """Return the axis of every searched option, in the order of the definition."""
    axes = []
    for name, axis in data.definition.space.items():
        seen = [trial.options[name] for trial in data.trials if trial.options and name in trial.options]
        axes.append(option_axis(name, axis, seen))
    return tuple(axes)


_LOG_FROM_RATIO = 20.0
_MARGIN_SHARE = 0.04
_FEW_DECADES = 1.2


def option_axis_layout(axis: OptionAxis) -> dict[str, Any]:
    """Return the settings of the axis of an option: log where the space is log, words for categories."""
    settings = theme.axis(escape(axis.option.rpartition(".")[2]))
    if axis.scale == "categories":
        ticks = list(range(len(axis.categories)))
        words = [escape(word) for word in axis.categories]
        return {**settings, "tickvals": ticks, "ticktext": words, "range": [-0.5, len(ticks) - 0.5]}
    if axis.scale == "linear":
        return {**settings, "range": _with_margin(axis.low, axis.high)}
    low, high = math.log10(axis.low), math.log10(axis.high)
    return {
        **settings,
        "type": "log",
        "range": _with_margin(low, high),
        "dtick": "D2" if high - low < _FEW_DECADES else 1,
        "exponentformat": "power",
        "tickfont": {"size": 11},
        "minor": {"ticks": "outside", "ticklen": 3, "showgrid": False},
    }


def score_axis_layout(drawn: Sequence[TrialPoint], points: PointSet) -> dict[str, Any]:
    """Return the settings of the left axis for the drawn points; where there is ground truth it is in front."""
    values = [point.value for point in drawn]
    above = {"overlaying": "y2"} if points.has_ground_truth else {}
    return {**theme.axis(**_scale(values)), **_coloured(points.unit.label, theme.GTF_DARK), **above}


def truth_axis_layout(drawn: Sequence[TrialPoint], points: PointSet) -> dict[str, Any]:
    """Return the settings of the right axis for the drawn points."""
    values = [point.ground_truth for point in drawn if math.isfinite(point.ground_truth)]
    settings = {**theme.axis(**_scale(values)), **_coloured(points.truth_label, theme.GROUND_TRUTH)}
    return {**settings, "side": "right", "showgrid": False}


def rim_axis_layout(points: PointSet) -> dict[str, Any]:
    """Return the settings of an invisible axis from 0 to 1, for marks that claim no value."""
    base = "y2" if points.has_ground_truth else "y"
    return {"overlaying": base, "range": [0, 1], "visible": False, "fixedrange": True}


def spreads_far(values: Sequence[float]) -> bool:
    """Return True if scores or errors spread so far that their axis should be logarithmic."""
    return bool(values) and min(values) > 0 and max(values) / min(values) > _LOG_FROM_RATIO


def _with_margin(low: float, high: float) -> list[float]:
    margin = _MARGIN_SHARE * (high - low or 1.0)
    return [low - margin, high + margin]


def _coloured(title: str, colour: str) -> dict[str, Any]:
    font = {"color": colour, "size": 13}
    return {"title": {"text": title, "standoff": 8, "font": font}, "tickfont": {"color": colour}}


def _scale(values: list[float]) -> dict[str, Any]:
    # Plotly would otherwise place the ticks of one axis to suit those of the other, at crooked numbers.
    return {"type": "log", "tickmode": "linear", "dtick": 1} if spreads_far(values) else {"tickmode": "auto"}


_LONGEST = 90


def trial_text(point: TrialPoint, points: PointSet) -> str:
    """Return the hover text of a trial."""
    name = "trial 0 (nominal)" if point.number == 0 else f"trial {point.number}"
    lines = [f"<b>{name}</b>"]
    if math.isfinite(point.value):
        lines.append(f"{points.unit.name} {significant(point.value)} {points.unit.symbol}")
    if point.state != "feasible":
        lines.append(f"{point.state}: {shortened(point.message)}" if point.message else point.state)
    if math.isfinite(point.low):
        lines.append(f"95 % interval {interval(point.low, point.high)}")
    if math.isfinite(point.ground_truth):
        lines.append(f"{points.truth_name} {significant(point.ground_truth, 4)}")
    if math.isfinite(point.coverage):
        lines.append(f"coverage {share(point.coverage)}")
    if point.collapsed > 0:
        lines.append(f"{share(point.collapsed)} of the noisy runs collapsed")
    return "<br>".join(lines)


def shortened(text: str, longest: int = _LONGEST) -> str:
    """Return a text on one line of at most ``longest`` characters, escaped for a figure."""
    line = " ".join(text.split())
    return escape(line if len(line) <= longest else line[: longest - 1] + "…")
