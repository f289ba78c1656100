"""Search several options of any kind: a few even points, then a fitted surface and TPE in turn."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from optuna import Study
from optuna.distributions import BaseDistribution, CategoricalDistribution
from optuna.samplers import BaseSampler, TPESampler
from optuna.trial import FrozenTrial, TrialState

from gtf_tune.study.search.refine import Axis, log_scores
from gtf_tune.study.search.surface import fit_surface, next_point
from gtf_tune.trajectory import FloatArray

MOST_POINTS = 100
"""Most trials that a surface is fitted to: half of them are the best ones, the others the latest."""

_GOLDEN_STEPS = 60
_FULL_SCALE = 1.0


class RefineManySampler(BaseSampler):
    """Sampler of several options; the same finished trials and seeds give the same choice.

    Every other trial is left to TPE, since the surface alone gets stuck where scores do not vary smoothly. Infeasible
    trials and those of other workers count as in `RefineSampler`. Scores far above the best one are
    compressed, so that poor regions do not decide how the surface is fitted near the best. ``start_seed`` places the
    even points, ``seed`` is that of the trial, and ``position`` its place in the search, its number unless given.
    """

    def __init__(
        self, distributions: Mapping[str, BaseDistribution], start_seed: int, seed: int, position: int | None = None
    ) -> None:
        self._distributions = dict(distributions)
        self._start_seed = start_seed
        self._seed = seed
        self._position = position
        self._otherwise = TPESampler(seed=seed)

    def infer_relative_search_space(self, study: Study, trial: FrozenTrial) -> dict[str, BaseDistribution]:
        """Return all options, which are chosen together."""
        if self._is_left_to_tpe(trial):
            return self._otherwise.infer_relative_search_space(study, trial)
        return self._distributions

    def sample_relative(
        self, study: Study, trial: FrozenTrial, search_space: Mapping[str, BaseDistribution]
    ) -> dict[str, Any]:
        """Return a value for every option of a trial; trial 0 is nominal and not asked for."""
        if self._is_left_to_tpe(trial):
            return self._otherwise.sample_relative(study, trial, dict(search_space))
        space = Space(tuple(search_space), tuple(_axis_of(distribution) for distribution in search_space.values()))
        position = self._position_of(trial)
        if position <= coarse_points(len(search_space)):
            return space.values(_even_point(position, len(search_space), self._start_seed))
        others = [other for other in study.get_trials(deepcopy=False) if other.number != trial.number]
        return space.values(self._choose([other for other in others if set(space.names) <= set(other.params)], space))

    def sample_independent(
        self, study: Study, trial: FrozenTrial, param_name: str, param_distribution: BaseDistribution
    ) -> Any:
        """Return what TPE chooses for one option by itself."""
        return self._otherwise.sample_independent(study, trial, param_name, param_distribution)

    def _is_left_to_tpe(self, trial: FrozenTrial) -> bool:
        position = self._position_of(trial)
        return position > coarse_points(len(self._distributions)) and position % 2 == 1

    def _position_of(self, trial: FrozenTrial) -> int:
        return trial.number if self._position is None else self._position

    def _choose(self, others: list[FrozenTrial], space: "Space") -> FloatArray:
        scores = log_scores(others)
        kept = _kept(scores)
        if len(kept) < 2:
            return np.random.default_rng(self._seed).random(len(space.names))
        points = np.array([space.point(others[index].params) for index in kept])
        values = _compressed(np.array([scores[index] for index in kept]))
        surface = fit_surface(points, values, space.unordered)
        pending = [space.point(trial.params) for trial in others if trial.state == TrialState.RUNNING]
        if pending:
            predicted = surface.mean(np.array(pending))
            points, values = np.concatenate([points, pending]), np.concatenate([values, predicted])
            surface = fit_surface(points, values, space.unordered)
        return next_point(surface, self._seed, space.snap)


def coarse_points(options: int) -> int:
    """Return how many even points come before the surface is used, nominal not counted."""
    return options + 1


@dataclass(frozen=True)
class Choices:
    """Map between the choices of an option and [0, 1]; numbers are ordered by size."""

    distribution: CategoricalDistribution

    @property
    def ordered(self) -> list[Any]:
        """Return the choices, numbers in ascending order."""
        choices = list(self.distribution.choices)
        return sorted(choices) if self.has_order else choices

    @property
    def has_order(self) -> bool:
        """Whether all choices are numbers."""
        return all(
            isinstance(choice, int | float) and not isinstance(choice, bool) for choice in self.distribution.choices
        )

    def place(self, value: Any) -> float:
        """Return the place of a choice."""
        ordered = self.ordered
        return (ordered.index(value) + 0.5) / len(ordered)

    def value(self, place: float) -> Any:
        """Return the choice at a place."""
        ordered = self.ordered
        return ordered[min(int(place * len(ordered)), len(ordered) - 1)]


@dataclass(frozen=True)
class Space:
    """Names of options, and the axes that map their values to [0, 1]."""

    names: tuple[str, ...]
    axes: tuple[Axis | Choices, ...]

    @property
    def unordered(self) -> Any:
        """Return which options, (d,), have values without an order."""
        return np.array([isinstance(axis, Choices) and not axis.has_order for axis in self.axes])

    def point(self, values: Mapping[str, Any]) -> FloatArray:
        """Return the point (d,) of a configuration."""
        return np.array([axis.place(values[name]) for name, axis in zip(self.names, self.axes, strict=True)])

    def values(self, point: FloatArray) -> dict[str, Any]:
        """Return the configuration nearest to a point (d,)."""
        places = zip(self.names, self.axes, point.tolist(), strict=True)
        return {name: axis.value(place) for name, axis, place in places}

    def snap(self, points: FloatArray) -> FloatArray:
        """Return the points (m, d) of the configurations nearest to points (m, d)."""
        columns = [_snapped(axis, points[:, column]) for column, axis in enumerate(self.axes)]
        return np.stack(columns, axis=1)


def _snapped(axis: Axis | Choices, places: FloatArray) -> FloatArray:
    if isinstance(axis, Axis) and not axis.has_steps:
        return places
    return np.array([axis.place(axis.value(place)) for place in places.tolist()])


def _axis_of(distribution: BaseDistribution) -> Axis | Choices:
    return Choices(distribution) if isinstance(distribution, CategoricalDistribution) else Axis.of(distribution)


def _even_point(number: int, options: int, seed: int) -> FloatArray:
    """Return point ``number`` of a sequence that fills the space evenly from a random start (Roberts, 2018)."""
    ratio = 2.0
    for _ in range(_GOLDEN_STEPS):
        ratio = (1.0 + ratio) ** (1.0 / (options + 1))
    steps = ratio ** -np.arange(1.0, options + 1.0)
    return np.asarray((np.random.default_rng(seed).random(options) + number * steps) % 1.0)


def _kept(scores: Mapping[int, float]) -> Sequence[int]:
    """Return the positions of the trials that the surface is fitted to, at most `MOST_POINTS`."""
    if len(scores) <= MOST_POINTS:
        return list(scores)
    best = set(sorted(scores, key=lambda index: scores[index])[: MOST_POINTS // 2])
    others = [index for index in scores if index not in best]
    return sorted([*best, *others[-(MOST_POINTS - len(best)) :]])


def _compressed(values: FloatArray) -> FloatArray:
    excess = (values - values.min()) / _FULL_SCALE
    return np.asarray(np.where(excess <= 1.0, excess, 1.0 + np.log(np.maximum(excess, 1.0))))
