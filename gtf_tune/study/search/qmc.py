"""Quasi-random search whose points follow from the numbers of trials."""

import math
from collections.abc import Mapping
from typing import Any

from optuna import Study
from optuna.distributions import BaseDistribution, CategoricalDistribution, FloatDistribution, IntDistribution
from optuna.samplers import BaseSampler
from optuna.trial import FrozenTrial


class NumberedPointsSampler(BaseSampler):
    """Sampler that takes point ``number`` of Sobol's sequence over all options, whoever draws it and when.

    Points and values are those of Optuna's `QMCSampler`. That one counts its draws, so a worker that died in between
    would skip a point, and workers that draw at the same time would get the same one.
    """

    def __init__(self, distributions: Mapping[str, BaseDistribution], number: int) -> None:
        self._distributions = dict(distributions)
        self._number = number

    def infer_relative_search_space(self, study: Study, trial: FrozenTrial) -> dict[str, BaseDistribution]:
        """Return all options, which are chosen together."""
        del study, trial
        return self._distributions

    def sample_relative(
        self, study: Study, trial: FrozenTrial, search_space: Mapping[str, BaseDistribution]
    ) -> dict[str, Any]:
        """Return the values at the point."""
        from scipy.stats.qmc import Sobol  # takes a second to import

        del study, trial
        engine = Sobol(len(search_space), scramble=False)
        if self._number:
            engine.fast_forward(self._number)
        places = engine.random(1)[0].tolist()
        return {
            name: value_at(distribution, place)
            for (name, distribution), place in zip(search_space.items(), places, strict=True)
        }

    def sample_independent(
        self, study: Study, trial: FrozenTrial, param_name: str, param_distribution: BaseDistribution
    ) -> Any:
        """Return the value of one option alone."""
        return self.sample_relative(study, trial, {param_name: param_distribution})[param_name]


def value_at(distribution: BaseDistribution, place: float) -> Any:
    """Return the value at a place in [0, 1) of a distribution, in which equal parts are equally probable."""
    if isinstance(distribution, CategoricalDistribution):
        return distribution.choices[int(place * len(distribution.choices))]
    if isinstance(distribution, IntDistribution):
        return _whole_number(distribution, place)
    if not isinstance(distribution, FloatDistribution):
        raise TypeError(f"expected one of Optuna's distributions, not {distribution}")
    low, high, step = distribution.low, distribution.high, distribution.step
    if step is not None:
        scaled = low - step / 2 + place * (high - low + step)
        return min(max(round((scaled - low) / step) * step + low, low), high)
    if not distribution.log:
        return min(low + place * (high - low), math.nextafter(high, high - 1))
    value = math.exp(math.log(low) + place * (math.log(high) - math.log(low)))
    return min(max(value, low), math.nextafter(high, high - 1))


def _whole_number(distribution: IntDistribution, place: float) -> int:
    low, high, step = distribution.low, distribution.high, distribution.step
    if distribution.log:
        first, last = math.log(low - step / 2), math.log(high + step / 2)
        value = round(math.exp(first + place * (last - first)))
    else:
        value = math.floor(place * (high - low + step) / step) * step + low
    return min(max(value, low), high)
