"""The axis of one searched option."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Literal

from gtf_tune.definition import Axis, RangeAxis
from gtf_tune.display import value_text
from gtf_tune.pipelines import OptionValue
from gtf_tune.report.study_data import StudyData

AxisScale = Literal["log", "linear", "categories"]
_LOG_FROM_RATIO = 10.0


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
    return OptionAxis(option, "log" if low > 0 and high / low >= _LOG_FROM_RATIO else "linear", low, high)


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


def searched_axes(data: StudyData) -> tuple[OptionAxis, ...]:
    """Return the axis of every searched option, in the order of the definition."""
    axes = []
    for name, axis in data.definition.space.items():
        seen = [trial.options[name] for trial in data.trials if trial.options and name in trial.options]
        axes.append(option_axis(name, axis, seen))
    return tuple(axes)
