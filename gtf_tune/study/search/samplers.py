"""Make the Optuna sampler and pruner that a definition names."""

import copy
import warnings
from typing import Any

from optuna import Study
from optuna.distributions import BaseDistribution, CategoricalDistribution
from optuna.exceptions import ExperimentalWarning
from optuna.pruners import BasePruner, NopPruner, WilcoxonPruner
from optuna.samplers import BaseSampler, CmaEsSampler, GPSampler, QMCSampler, RandomSampler, TPESampler
from optuna.trial import FrozenTrial

from gtf_tune.definition import DEFAULT_TRIALS, SearchDefinition, StudyDefinition
from gtf_tune.errors import DefinitionError
from gtf_tune.study.runs.seeds import SeedSource
from gtf_tune.study.scoring.early_stopping import PRUNER_FIRST
from gtf_tune.study.search.refine import RefineSampler
from gtf_tune.study.search.refine_many import RefineManySampler
from gtf_tune.study.search.space import SearchSpace

WILCOXON_P = 0.05
WILCOXON_FEWEST = 8
"""Noisy runs of a trial from which on the pruner can save any worth having."""

_FEWEST_STARTUP = 10
_STARTUP_PER_OPTION = 4

_EXTRAS = {"gp": ("torch", "gp"), "cmaes": ("cmaes", "cmaes")}
_BLIND_TO_STOPPED = ("gp", "cmaes")


class _NumberedPoints(QMCSampler):
    """Take one point of the sequence, whoever draws it and when.

    Optuna counts the draws: a worker that died while it drew would leave a point out, and workers that draw at the same
    time would get the same one.
    """

    def __init__(self, point: int, seed: int) -> None:
        super().__init__(seed=seed, warn_independent_sampling=False)
        self._point = point

    def _find_sample_id(self, study: Study, search_space: dict[str, BaseDistribution]) -> int:
        del study, search_space
        return self._point


class _FeasibleScale(GPSampler):
    """Model the scores of infeasible trials as the worst feasible one; their constraint says how far out they lie.

    Their penalty is hundreds of times as large, and beside it Optuna's process takes all feasible scores for equal.
    """

    def _sample_relative_impl(
        self,
        study: Study,
        completed_trials: list[FrozenTrial],
        running_trials: list[FrozenTrial],
        search_space: dict[str, BaseDistribution],
    ) -> dict[str, Any]:
        return super()._sample_relative_impl(study, without_penalties(completed_trials), running_trials, search_space)


def without_penalties(completed: list[FrozenTrial]) -> list[FrozenTrial]:
    """Return the trials with the worst feasible value in place of penalties; as they are where none is feasible."""
    feasible = [all(violation <= 0 for violation in one.constraints.values()) for one in completed]
    values = [one.value for one, works in zip(completed, feasible, strict=True) if works and one.value is not None]
    if not values:
        return completed
    return [one if works else _with_value(one, max(values)) for one, works in zip(completed, feasible, strict=True)]


def _with_value(trial: FrozenTrial, value: float) -> FrozenTrial:
    copied = copy.copy(trial)
    copied.value = value
    return copied


def make_sampler(search: SearchDefinition, number: int, space: SearchSpace) -> BaseSampler:
    """Return the sampler that chooses the options of trial ``number``.

    Its seed follows from the study's seed and the number alone, so a resumed study goes on as if it had never stopped.
    The quasi-random sampler keeps one seed: its points are one sequence, numbered by the trials after nominal. A grid
    is enqueued, and only trials beyond it fall back to random search.
    """
    require_extra(search.sampler)
    seeds = SeedSource(search.seed)
    seed = seeds.sampler_seed(number)
    makers: dict[str, Any] = {
        "tpe": lambda: TPESampler(
            seed=seed, n_startup_trials=startup_trials(len(space.axes), search.trials or DEFAULT_TRIALS)
        ),
        "refine": lambda: _refine(space, seeds.sampler_seed(0), seed),
        "gp": lambda: _FeasibleScale(seed=seed, deterministic_objective=False),
        "cmaes": lambda: CmaEsSampler(seed=seed, warn_independent_sampling=False),
        "qmc": lambda: _NumberedPoints(max(number - 1, 0), seeds.sampler_seed(0)),
        "random": lambda: RandomSampler(seed=seed),
        "grid": lambda: RandomSampler(seed=seed),
    }
    sampler: BaseSampler = makers[search.sampler]()
    return sampler


def startup_trials(options: int, trials: int) -> int:
    """Return after how many random trials TPE begins to learn.

    Optuna begins after ten, of any number of options. With five it then settles for the wrong word of an option more
    often than with twenty (docs/performance.md); no more than a third of the budget is spent on this.
    """
    return max(_FEWEST_STARTUP, min(_STARTUP_PER_OPTION * options, trials // 3))


def _refine(space: SearchSpace, start_seed: int, seed: int) -> BaseSampler:
    axes = {axis.name: axis.distribution for axis in space.axes}
    if len(axes) == 1 and not isinstance(space.axes[0].distribution, CategoricalDistribution):
        return RefineSampler(float(space.axes[0].nominal))
    return RefineManySampler(axes, start_seed, seed)


def make_pruner(search: SearchDefinition) -> BasePruner:
    """Return the pruner, which is asked between noisy runs."""
    if search.pruner != "wilcoxon":
        return NopPruner()
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", ExperimentalWarning)
        return WilcoxonPruner(p_threshold=WILCOXON_P, n_startup_steps=PRUNER_FIRST)


def check_search(definition: StudyDefinition) -> None:
    """Raise one `DefinitionError` that names everything that sampler, pruner and sizing cannot do together."""
    faults = _stopping_faults(definition)
    if faults:
        raise DefinitionError("; ".join(faults))
    require_extra(definition.search.sampler)


def require_extra(sampler: str) -> None:
    """Raise `DefinitionError` with the command that installs what a sampler needs."""
    if sampler not in _EXTRAS:
        return
    module, extra = _EXTRAS[sampler]
    try:
        __import__(module)
    except ImportError as error:
        raise DefinitionError(
            f"sampler '{sampler}' needs the package '{module}'; install it with: pip install 'gtf-tune[{extra}]'"
        ) from error


def _stopping_faults(definition: StudyDefinition) -> list[str]:
    """Return what forbids to stop trials early, where that is asked for."""
    gtf, search = definition.gtf, definition.search
    adaptive, pruned = gtf.noisy_runs_min < gtf.noisy_runs_max, search.pruner == "wilcoxon"
    asked = "pruner = 'wilcoxon'" if pruned else "noisy_runs = { min, max }"
    faults: list[str] = []
    if adaptive and pruned:
        faults.append(
            "noisy_runs = { min, max } and pruner = 'wilcoxon' both stop trials early; give a fixed number of noisy "
            "runs, or drop the pruner"
        )
    if pruned and gtf.noisy_runs_max < WILCOXON_FEWEST:
        faults.append(
            f"pruner = 'wilcoxon' cannot decide before noisy run {PRUNER_FIRST}, so with {gtf.noisy_runs_max} noisy "
            f"runs it saves nothing; give it {WILCOXON_FEWEST} or more, or drop it"
        )
    if (adaptive or pruned) and not gtf.common_noise:
        faults.append(f"{asked} compares trials on the noise that they share; set common_noise = true or drop it")
    if (adaptive or pruned) and search.sampler in _BLIND_TO_STOPPED:
        faults.append(
            f"sampler '{search.sampler}' does not learn from trials that were stopped early and would repeat them; "
            f"use sampler 'refine' or 'tpe', or drop {asked}"
        )
    return faults
