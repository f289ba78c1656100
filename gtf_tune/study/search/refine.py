"""Search one numeric option: a few even steps across its axis, then where the fitted curve expects most."""

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from optuna import Study
from optuna.distributions import BaseDistribution, FloatDistribution, IntDistribution
from optuna.samplers import BaseSampler
from optuna.trial import FrozenTrial, TrialState

from gtf_tune.study.search.curve import fit_curve, next_place
from gtf_tune.trajectory import FloatArray

COARSE = 3
"""Even steps before the curve is used; nominal comes before them."""

_CANDIDATES = 301
_SAME = 1e-8
_INFEASIBLE = math.log(2.0)


class RefineSampler(BaseSampler):
    """Sampler of a single numeric option; deterministic, and safe beside other workers.

    An infeasible trial counts as twice the worst score; one that another worker runs as what the curve predicts without
    it. A step that falls on
    ``nominal``, which trial 0 measures, is left out. ``position`` is that of the trial in the search, its number unless
    given.
    """

    def __init__(self, nominal: float, position: int | None = None) -> None:
        self._nominal = nominal
        self._position = position

    def infer_relative_search_space(self, study: Study, trial: FrozenTrial) -> dict[str, BaseDistribution]:
        """Return nothing: the only option is sampled by itself."""
        del study, trial
        return {}

    def sample_relative(
        self, study: Study, trial: FrozenTrial, search_space: Mapping[str, BaseDistribution]
    ) -> dict[str, Any]:
        """Return nothing."""
        del study, trial, search_space
        return {}

    def sample_independent(
        self, study: Study, trial: FrozenTrial, param_name: str, param_distribution: BaseDistribution
    ) -> float | int:
        """Return the value for a trial; trial 0 is nominal and not asked for."""
        axis = Axis.of(param_distribution)
        steps = [value for value in axis.coarse() if not math.isclose(value, self._nominal, rel_tol=_SAME)]
        position = max(trial.number if self._position is None else self._position, 1)
        if position <= len(steps):
            return steps[position - 1]
        others = [other for other in study.get_trials(deepcopy=False) if other.number != trial.number]
        return axis.value(_choose([other for other in others if param_name in other.params], param_name, axis))


@dataclass(frozen=True)
class Axis:
    """Map between the values of a distribution and [0, 1]."""

    distribution: FloatDistribution | IntDistribution

    @classmethod
    def of(cls, distribution: BaseDistribution) -> "Axis":
        """Return the axis of a numeric distribution, or raise `TypeError`."""
        if not isinstance(distribution, FloatDistribution | IntDistribution):
            raise TypeError(f"expected a distribution of numbers, not {distribution}")
        return cls(distribution)

    def place(self, value: float) -> float:
        """Return the place of a value in [0, 1]."""
        low, high = self._ends
        return (self._scaled(value) - low) / (high - low)

    def value(self, place: float) -> float | int:
        """Return the allowed value nearest to a place."""
        low, high = self._ends
        scaled = low + place * (high - low)
        value = math.exp(scaled) if self.distribution.log else scaled
        step = self.distribution.step
        if step is not None:
            value = self.distribution.low + step * round((value - self.distribution.low) / step)
        value = min(max(float(f"{value:.9g}"), self.distribution.low), self.distribution.high)
        return round(value) if isinstance(self.distribution, IntDistribution) else float(value)

    def coarse(self) -> list[float | int]:
        """Return the values of the even steps; fewer where whole numbers or steps are far apart."""
        return list(dict.fromkeys(self.value(number / (COARSE + 1)) for number in range(1, COARSE + 1)))

    def candidates(self, tried: FloatArray) -> FloatArray:
        """Return places to choose from: a fine grid, or the untried values where there are few of them."""
        values = dict.fromkeys(self.value(place) for place in np.linspace(0.0, 1.0, _CANDIDATES).tolist())
        places = np.array([self.place(value) for value in values])
        untried = np.array([place for place in places.tolist() if not np.isclose(place, tried, atol=1e-9).any()])
        return untried if len(untried) else places

    @property
    def has_steps(self) -> bool:
        """Whether the values are discrete."""
        return isinstance(self.distribution, IntDistribution) or self.distribution.step is not None

    @property
    def _ends(self) -> tuple[float, float]:
        return self._scaled(self.distribution.low), self._scaled(self.distribution.high)

    def _scaled(self, value: float) -> float:
        return math.log(value) if self.distribution.log else float(value)


def _choose(others: list[FrozenTrial], name: str, axis: Axis) -> float:
    known = log_scores(others)
    if not known:
        return _farthest(axis, [axis.place(trial.params[name]) for trial in others])
    places = np.array([axis.place(others[index].params[name]) for index in known])
    values = np.array(list(known.values()))
    pending = np.array([axis.place(trial.params[name]) for trial in others if trial.state == TrialState.RUNNING])
    if len(pending):
        predicted = fit_curve(places, values).mean(pending)
        places, values = np.concatenate([places, pending]), np.concatenate([values, predicted])
    return next_place(fit_curve(places, values), axis.candidates(places))


def _farthest(axis: Axis, tried: list[float]) -> float:
    """Return the place farthest from all tried ones, for as long as no trial is feasible."""
    places = axis.candidates(np.array(tried))
    gaps = np.abs(places[:, np.newaxis] - np.array(tried)).min(axis=1, initial=math.inf)
    return float(places[int(np.argmax(gaps))])


def log_scores(trials: list[FrozenTrial]) -> dict[int, float]:
    """Return comparable logarithms of the scores of finished trials, by their position in the list."""
    complete = {
        index: math.log(trial.value)
        for index, trial in enumerate(trials)
        if trial.state == TrialState.COMPLETE and _is_feasible(trial) and trial.value is not None and trial.value > 0
    }
    if not complete:
        return {}
    worst = max(complete.values())
    # Earlier versions stopped poor trials early; their scores are of fewer runs.
    stopped = {index: worst for index, trial in enumerate(trials) if trial.state == TrialState.PRUNED}
    infeasible = {
        index: worst + _INFEASIBLE
        for index, trial in enumerate(trials)
        if trial.state == TrialState.COMPLETE and not _is_feasible(trial)
    }
    return complete | stopped | infeasible


def _is_feasible(trial: FrozenTrial) -> bool:
    return all(value <= 0 for value in trial.constraints.values())
