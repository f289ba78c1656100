"""Make the Optuna sampler and pruner that a definition names."""

from typing import Any

from optuna.pruners import BasePruner, NopPruner, WilcoxonPruner
from optuna.samplers import BaseSampler, CmaEsSampler, GPSampler, QMCSampler, RandomSampler, TPESampler

from gtf_tune.definition import SearchDefinition
from gtf_tune.errors import DefinitionError
from gtf_tune.study.seeds import SeedSource

_WILCOXON_P = 0.05
_WILCOXON_STARTUP = 6
_EXTRAS = {"gp": ("torch", "gp"), "cmaes": ("cmaes", "cmaes")}


def make_sampler(search: SearchDefinition, ordinal: int) -> BaseSampler:
    """Return the sampler that chooses the options of trial ``ordinal``.

    Its seed follows from the study's seed and the ordinal alone, so a resumed study goes on as if it had never stopped.
    The quasi-random sampler keeps one seed: its points are one sequence, numbered by the trials. A grid is enqueued,
    and only trials beyond it fall back to random search.
    """
    require_extra(search.sampler)
    seeds = SeedSource(search.seed)
    seed = seeds.sampler_seed(ordinal)
    makers: dict[str, Any] = {
        "tpe": lambda: TPESampler(seed=seed),
        "gp": lambda: GPSampler(seed=seed, deterministic_objective=False),
        "cmaes": lambda: CmaEsSampler(seed=seed),
        "qmc": lambda: QMCSampler(seed=seeds.sampler_seed(0), warn_independent_sampling=False),
        "random": lambda: RandomSampler(seed=seed),
        "grid": lambda: RandomSampler(seed=seed),
    }
    sampler: BaseSampler = makers[search.sampler]()
    return sampler


def make_pruner(search: SearchDefinition) -> BasePruner:
    """Return the pruner; Wilcoxon cannot fire before its sixth instance at p = 0.05 and only helps from about eight."""
    if search.pruner == "wilcoxon":
        return WilcoxonPruner(p_threshold=_WILCOXON_P, n_startup_steps=_WILCOXON_STARTUP)
    return NopPruner()


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
