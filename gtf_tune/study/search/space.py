"""The search space of a study: Optuna distributions, grid points and nominal values."""

import contextlib
import itertools
import math
import warnings
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace
from types import MappingProxyType

from optuna import Trial
from optuna.distributions import BaseDistribution, CategoricalDistribution, FloatDistribution, IntDistribution

from gtf_tune.definition import Axis, RangeAxis, StudyDefinition, ValuesAxis
from gtf_tune.errors import DefinitionError, GtfTuneError, first_remedy
from gtf_tune.pipelines import OptionSpec, OptionTable, OptionValue, option_text

_ROUNDING = 1e-9


@dataclass(frozen=True)
class SearchAxis:
    """Searched option: its nominal value, its distribution and the values that a grid takes."""

    name: str
    nominal: OptionValue
    distribution: BaseDistribution
    grid: tuple[OptionValue, ...]

    @property
    def is_log(self) -> bool:
        """Whether the axis is searched and drawn in logarithms."""
        return bool(getattr(self.distribution, "log", False))

    @property
    def words(self) -> str:
        """Return which values are searched, in words."""
        if isinstance(self.distribution, CategoricalDistribution):
            return ", ".join(option_text(value) for value in self.distribution.choices)
        if isinstance(self.distribution, FloatDistribution | IntDistribution):
            return f"[{self.distribution.low:g}, {self.distribution.high:g}]"
        raise TypeError(f"expected one of Optuna's distributions, not {self.distribution}")

    def takes(self, value: OptionValue) -> bool:
        """Return True if a trial can have this value."""
        if isinstance(self.distribution, CategoricalDistribution):
            return any(value == choice and isinstance(value, type(choice)) for choice in self.distribution.choices)
        if isinstance(self.distribution, FloatDistribution | IntDistribution) and not isinstance(value, str):
            return self.distribution.low <= value <= self.distribution.high
        return False


@dataclass(frozen=True)
class SearchSpace:
    """Axes of a study, in the order of its definition."""

    axes: tuple[SearchAxis, ...]

    @property
    def nominal(self) -> dict[str, OptionValue]:
        """Return the user's baseline for every searched option, the pipeline's default where there is none."""
        return {axis.name: axis.nominal for axis in self.axes}

    @property
    def distributions(self) -> dict[str, BaseDistribution]:
        """Return Optuna's distribution of every searched option."""
        return {axis.name: axis.distribution for axis in self.axes}

    def grid(self) -> Iterator[dict[str, OptionValue]]:
        """Yield every grid point except nominal, the last axis turning fastest."""
        nominal = self.nominal
        for values in itertools.product(*(axis.grid for axis in self.axes)):
            point = {axis.name: value for axis, value in zip(self.axes, values, strict=True)}
            if point != nominal:
                yield point

    def grid_size(self) -> int:
        """Return the number of trials of a full grid, nominal included."""
        inside = all(axis.nominal in axis.grid for axis in self.axes)
        return math.prod(len(axis.grid) for axis in self.axes) + (0 if inside else 1)

    def suggest(self, trial: Trial) -> dict[str, OptionValue]:
        """Return the values that the sampler of a trial chooses for all axes."""
        with _off_step_allowed():
            return {axis.name: _suggest(trial, axis) for axis in self.axes}


def build_space(definition: StudyDefinition, table: OptionTable) -> SearchSpace:
    """Return the search space, or raise one `DefinitionError` that names every fault."""
    nominal = definition.pipeline.nominal
    faults = space_faults(definition.space, table, nominal)
    if faults:
        raise DefinitionError("; ".join(map(str, faults)), remedy=first_remedy(faults))
    exhaustive = definition.search.sampler == "grid"
    return SearchSpace(
        tuple(
            _build_axis(_with_nominal(table.specs[name], nominal), axis, exhaustive)
            for name, axis in definition.space.items()
        )
    )


def _with_nominal(spec: OptionSpec, nominal: Mapping[str, OptionValue]) -> OptionSpec:
    """Return an option whose default is the user's baseline, where that says anything of it."""
    if spec.name not in nominal:
        return spec
    return replace(spec, default=OptionTable("", {spec.name: spec}).check_one(spec.name, nominal[spec.name]))


def space_faults(
    space: Mapping[str, Axis], table: OptionTable, nominal: Mapping[str, OptionValue] = MappingProxyType({})
) -> list[GtfTuneError]:
    """Return an error for every axis that does not suit the pipeline and the user's baseline."""
    faults: list[GtfTuneError] = []
    for name, axis in space.items():
        try:
            _check_axis(table, name, axis, nominal)
        except GtfTuneError as error:
            faults.append(error)
    return faults


def _check_axis(table: OptionTable, name: str, axis: Axis, nominal: Mapping[str, OptionValue]) -> None:
    ends = [axis.low, axis.high] if isinstance(axis, RangeAxis) else list(axis.values)
    for value in ends:
        table.check({name: value})
    if isinstance(axis, ValuesAxis):
        return
    spec = table.specs[name]
    if spec.kind not in ("int", "float"):
        raise DefinitionError(f"option '{name}' is a {spec.kind}; give its axis as {{ values = [...] }}")
    baseline, whose = (nominal[name], "nominal value") if name in nominal else (spec.default, "pipeline's default")
    if isinstance(baseline, int | float) and not axis.low <= baseline <= axis.high:
        raise DefinitionError(
            f"the range of '{name}' [{axis.low:g}, {axis.high:g}] leaves out the {whose} {baseline:g}, which trial 0 "
            "measures every improvement against; widen the range"
        )
    if axis.step is not None and spec.kind == "int" and axis.step != int(axis.step):
        raise DefinitionError(f"option '{name}' takes whole numbers; its step cannot be {axis.step:g}")
    if axis.step is not None and axis.step * (1 - _ROUNDING) > axis.high - axis.low:
        raise DefinitionError(
            f"the range of '{name}' [{axis.low:g}, {axis.high:g}] has no room for a step of {axis.step:g}; give a "
            "smaller one"
        )


def _build_axis(spec: OptionSpec, axis: Axis, exhaustive: bool) -> SearchAxis:
    if isinstance(axis, RangeAxis):
        return _range_axis(spec, axis)
    values = tuple(_as_kind(spec, value) for value in axis.values)
    choices = values if spec.default in values else (spec.default, *values)
    if exhaustive and spec.kind in ("int", "float"):
        return SearchAxis(spec.name, spec.default, _hull(spec, choices), values)
    return SearchAxis(spec.name, spec.default, CategoricalDistribution(choices), values)


def _range_axis(spec: OptionSpec, axis: RangeAxis) -> SearchAxis:
    distribution: BaseDistribution
    with _off_step_allowed():
        if spec.kind == "int":
            distribution = IntDistribution(int(axis.low), int(axis.high), log=axis.log, step=int(axis.step or 1))
        else:
            distribution = FloatDistribution(axis.low, axis.high, log=axis.log, step=axis.step)
    return SearchAxis(spec.name, spec.default, distribution, tuple(grid_values(spec, axis)))


@contextlib.contextmanager
def _off_step_allowed() -> Iterator[None]:
    """Suppress Optuna's warnings about ranges that end between two steps and nominal values that lie there."""
    with warnings.catch_warnings():
        warnings.filterwarnings("ignore", message="The distribution is specified by|Fixed parameter")
        yield


def grid_values(spec: OptionSpec, axis: RangeAxis) -> list[OptionValue]:
    """Return the values that a grid takes on an axis, in ascending order."""
    if axis.step is not None:
        count = math.floor((axis.high - axis.low) / axis.step + _ROUNDING) + 1
        values = [axis.low + axis.step * number for number in range(count)]
    elif axis.log:
        ratio = math.log(axis.high / axis.low)
        values = [axis.low * math.exp(ratio * number / (axis.points - 1)) for number in range(axis.points)]
    else:
        span = axis.high - axis.low
        values = [axis.low + span * number / (axis.points - 1) for number in range(axis.points)]
    values = [min(max(float(f"{value:.12g}"), axis.low), axis.high) for value in values]
    if spec.kind == "int":
        return list(dict.fromkeys(round(value) for value in values))
    return [float(value) for value in values]


def _hull(spec: OptionSpec, values: tuple[OptionValue, ...]) -> BaseDistribution:
    """Return the interval around a numeric list: a grid tries every value, and plots want a numeric axis."""
    numbers = [value for value in values if isinstance(value, int | float)]
    low, high = min(numbers), max(numbers)
    log = low > 0 and high / low >= 10
    if low == high:
        return CategoricalDistribution(values)
    if spec.kind == "int":
        return IntDistribution(int(low), int(high), log=log)
    return FloatDistribution(float(low), float(high), log=log)


def _as_kind(spec: OptionSpec, value: OptionValue) -> OptionValue:
    if spec.choices:
        return str(value)
    if spec.kind == "float" and not isinstance(value, bool | str):
        return float(value)
    if spec.kind == "int" and not isinstance(value, bool | str):
        return int(value)
    return value


def _suggest(trial: Trial, axis: SearchAxis) -> OptionValue:
    distribution = axis.distribution
    if isinstance(distribution, FloatDistribution):
        return trial.suggest_float(
            axis.name, distribution.low, distribution.high, step=distribution.step, log=distribution.log
        )
    if isinstance(distribution, IntDistribution):
        return trial.suggest_int(
            axis.name, distribution.low, distribution.high, step=distribution.step, log=distribution.log
        )
    if isinstance(distribution, CategoricalDistribution):
        chosen = trial.suggest_categorical(axis.name, distribution.choices)
        if isinstance(chosen, bool | int | float | str):
            return chosen
    raise DefinitionError(f"axis '{axis.name}' has a kind of values that cannot be searched")


def option_faults(
    space: SearchSpace, definition: StudyDefinition, table: OptionTable, options: Mapping[str, OptionValue]
) -> list[str]:
    """Return a sentence for every option that a trial of a study cannot have."""
    axes = {axis.name: axis for axis in space.axes}
    faults: list[str] = []
    for name, value in options.items():
        if name in axes:
            faults += _axis_faults(axes[name], value)
            continue
        always = definition.fixed_options.get(name, table.specs[name].default)
        if value != always:
            faults.append(f"option '{name}' is not searched but {always!r} in every trial, not {value!r}; leave it out")
    return faults


def _axis_faults(axis: SearchAxis, value: OptionValue) -> list[str]:
    if axis.takes(value):
        return []
    return [f"option '{axis.name}' is searched over {axis.words}, not {value!r}; widen that, or choose another value"]
