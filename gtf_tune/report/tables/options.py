"""Lay the trials out over the axis of one option."""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Literal

from gtf_tune.definition import Axis, RangeAxis
from gtf_tune.display import value_text
from gtf_tune.pipelines import OptionValue
from gtf_tune.report.tables.points import PointSet, TrialPoint

AxisScale = Literal["log", "linear", "categories"]

_LOG_FROM_RATIO = 10.0
_MOST_LEVELS = 25


@dataclass(frozen=True)
class OptionAxis:
    """Hold the axis of one option: its scale, its ends, and the words of its categories in order."""

    option: str
    scale: AxisScale
    low: float
    high: float
    categories: tuple[str, ...] = ()

    def place(self, value: OptionValue) -> float:
        """Return where a value lies on the axis: the number itself, or the position of its category."""
        return float(self.categories.index(value_text(value))) if self.scale == "categories" else float(value)


@dataclass(frozen=True)
class OptionCurve:
    """Hold the points of one option, sorted along its axis.

    ``line`` are the points to connect: all of them where only this option is searched, the best at each level where
    there are few levels, otherwise none, because the other options vary between neighbours. ``stopped`` are trials
    that were pruned with a score, ``outside`` those without any, each with its place.
    """

    axis: OptionAxis
    points: tuple[TrialPoint, ...]
    places: tuple[float, ...]
    line: tuple[int, ...]
    stopped: tuple[tuple[float, TrialPoint], ...]
    outside: tuple[tuple[float, TrialPoint], ...]
    is_alone: bool

    @property
    def nominal(self) -> int | None:
        """Return the index of the nominal trial."""
        return next((index for index, point in enumerate(self.points) if point.ordinal == 0), None)

    @property
    def best(self) -> int | None:
        """Return the index of the smallest score."""
        return _index_of_least([point.value for point in self.points])

    @property
    def best_ground_truth(self) -> int | None:
        """Return the index of the smallest error against ground truth."""
        return _index_of_least([point.ground_truth for point in self.points])


def option_axis(option: str, axis: Axis, seen: Sequence[OptionValue] = ()) -> OptionAxis:
    """Return the axis on which a searched option is drawn: log where the space is, with room for all values seen."""
    if isinstance(axis, RangeAxis):
        numbers = [axis.low, axis.high, *(value for value in seen if isinstance(value, int | float))]
        return OptionAxis(option, "log" if axis.log else "linear", float(min(numbers)), float(max(numbers)))
    values = [*(value for value in dict.fromkeys(seen) if value not in axis.values), *axis.values]
    numbers = [float(value) for value in values if isinstance(value, int | float) and not isinstance(value, bool)]
    if len(numbers) < len(values) or len(numbers) < 2:
        words = tuple(value_text(value) for value in values)
        return OptionAxis(option, "categories", 0.0, float(len(words) - 1), words)
    low, high = min(numbers), max(numbers)
    return OptionAxis(option, "log" if low > 0 and high / low >= _LOG_FROM_RATIO else "linear", low, high)


def option_curve(points: PointSet, axis: OptionAxis, searched: int) -> OptionCurve:
    """Return the trials over one option; ``searched`` is how many options the study varies."""
    placed = [
        (axis.place(point.options[axis.option]), point) for point in points.points if axis.option in point.options
    ]
    scored = sorted(((x, point) for x, point in placed if point.is_scored), key=lambda one: (one[0], one[1].ordinal))
    places = tuple(x for x, _ in scored)
    is_alone = searched == 1
    return OptionCurve(
        axis=axis,
        points=tuple(point for _, point in scored),
        places=places,
        line=tuple(range(len(scored))) if is_alone else _best_of_each_level(places, [one.value for _, one in scored]),
        stopped=tuple((x, point) for x, point in placed if point.state == "pruned" and math.isfinite(point.value)),
        outside=tuple((x, point) for x, point in placed if point.state != "running" and math.isnan(point.value)),
        is_alone=is_alone,
    )


def options_at_an_edge(space: Mapping[str, Axis], chosen: Mapping[str, OptionValue]) -> tuple[str, ...]:
    """Return the options whose chosen number is an end of its range: a better one may lie beyond."""
    found = []
    for option, axis in space.items():
        value = chosen.get(option)
        if isinstance(axis, RangeAxis) and isinstance(value, int | float) and not isinstance(value, bool):
            near = 1e-6 * (abs(axis.low) + abs(axis.high)) if not axis.log else 1e-6 * abs(value)
            if min(abs(value - axis.low), abs(value - axis.high)) <= near:
                found.append(option)
    return tuple(found)


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
