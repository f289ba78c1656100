"""Copy the trials into an Optuna study in memory, in shown units, for Optuna's own figures."""

from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager

import optuna
from optuna.distributions import BaseDistribution, CategoricalDistribution, FloatDistribution
from optuna.trial import FrozenTrial, TrialState, create_trial

from gtf_tune.display import value_text
from gtf_tune.report.tables.options import OptionAxis
from gtf_tune.report.tables.points import PointSet, TrialPoint

_CONSTRAINT = "coverage"
_ABOVE_THE_WORST = 1.1
_INCOMPLETE = {"pruned": TrialState.PRUNED, "failed": TrialState.FAIL}


def optuna_copy(points: PointSet, axes: Sequence[OptionAxis]) -> optuna.Study:
    """Return a study with the same trial numbers, options and states.

    Infeasible trials have a penalty for a value, which would hide all others in a figure: here they lie a tenth above
    the worst feasible value, and are marked as infeasible.
    """
    with _without_messages():
        study = optuna.create_study(direction="minimize", sampler=optuna.samplers.RandomSampler(seed=0))
    ceiling = infeasible_level(points)
    by_name = {axis.option: axis for axis in axes}
    study.add_trials([_copied(point, by_name, ceiling) for point in points.points])
    return study


def infeasible_level(points: PointSet) -> float:
    """Return where infeasible trials are drawn: a tenth above the worst feasible value."""
    return _ABOVE_THE_WORST * max((point.value for point in points.scored), default=1.0)


def _copied(point: TrialPoint, axes: Mapping[str, OptionAxis], ceiling: float) -> FrozenTrial:
    params = {name: _copied_value(axes[name], value) for name, value in point.options.items() if name in axes}
    complete = point.is_scored or point.state == "infeasible"
    return create_trial(
        state=TrialState.COMPLETE if complete else _INCOMPLETE.get(point.state, TrialState.RUNNING),
        value=(point.value if point.is_scored else ceiling) if complete else None,
        params=params,
        distributions={name: _distribution(axes[name]) for name in params},
        constraints={_CONSTRAINT: 0.0 if point.is_scored else 1.0} if complete else None,
    )


def _copied_value(axis: OptionAxis, value: bool | int | float | str) -> float | str:
    return value_text(value) if axis.scale == "categories" else float(value)


def _distribution(axis: OptionAxis) -> BaseDistribution:
    if axis.scale == "categories":
        return CategoricalDistribution(axis.categories)
    return FloatDistribution(axis.low, axis.high, log=axis.scale == "log")


@contextmanager
def _without_messages() -> Iterator[None]:
    before = optuna.logging.get_verbosity()
    optuna.logging.set_verbosity(optuna.logging.WARNING)
    try:
        yield
    finally:
        optuna.logging.set_verbosity(before)
