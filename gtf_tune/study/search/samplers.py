"""Samplers by the names that a definition gives them."""

import inspect
import warnings
from collections.abc import Callable

from optuna.distributions import CategoricalDistribution
from optuna.exceptions import ExperimentalWarning
from optuna.samplers import BaseSampler, RandomSampler, TPESampler

from gtf_tune.definition import DEFAULT_TRIALS, SearchDefinition, StudyDefinition
from gtf_tune.definition.model import FORMER_SAMPLERS
from gtf_tune.definition.objects import load_object
from gtf_tune.errors import DefinitionError
from gtf_tune.store.optuna.foreign_sampler import ForeignSampler
from gtf_tune.study.runs.plan import SeedSource
from gtf_tune.study.search.qmc import NumberedPointsSampler
from gtf_tune.study.search.refine import RefineSampler
from gtf_tune.study.search.refine_many import RefineManySampler
from gtf_tune.study.search.space import SearchSpace

_FEWEST_STARTUP = 10
_STARTUP_PER_OPTION = 4


def make_sampler(search: SearchDefinition, position: int, space: SearchSpace) -> BaseSampler:
    """Return the sampler that chooses the options of one trial, at ``position`` of the search: nominal has 0.

    Its seed follows from the study's seed and the position alone: a resumed study goes on as if it had never stopped.
    The quasi-random points are one sequence, numbered by the trials after nominal. The points of a grid are not drawn,
    and only trials beyond it fall back to random search.

    Raises
    ------
    DefinitionError
        The sampler was removed from gtf-tune, cannot be imported, or refuses its arguments.
    """
    seeds = SeedSource(search.seed)
    seed = seeds.sampler_seed(position)
    if search.is_foreign:
        return _foreign_sampler(search, seed)
    makers: dict[str, Callable[[], BaseSampler]] = {
        "tpe": lambda: TPESampler(
            seed=seed, n_startup_trials=startup_trials(len(space.axes), search.trials or DEFAULT_TRIALS)
        ),
        "refine": lambda: _refine(space, position, seeds.sampler_seed(0), seed),
        "qmc": lambda: NumberedPointsSampler(space.distributions, max(position - 1, 0)),
        "random": lambda: RandomSampler(seed=seed),
        "grid": lambda: RandomSampler(seed=seed),
    }
    if search.sampler not in makers:
        raise DefinitionError(
            f"sampler '{search.sampler}' is no longer part of gtf-tune; go on with another one, such as 'refine' or "
            f"'{FORMER_SAMPLERS[search.sampler]}', which it stood for",
            remedy=("sampler",),
        )
    return makers[search.sampler]()


def _foreign_sampler(search: SearchDefinition, seed: int) -> BaseSampler:
    """Return a sampler named ``module:Class``, with the seed unless it takes none or its arguments contain one."""
    made_by = load_object(search.sampler, "sampler")
    if not (isinstance(made_by, type) and issubclass(made_by, BaseSampler)):
        raise DefinitionError(
            f"'{search.sampler}' is not a class of Optuna samplers; name one that derives from BaseSampler"
        )
    arguments = dict(search.sampler_arguments)
    if "seed" in inspect.signature(made_by).parameters:
        arguments.setdefault("seed", seed)
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", ExperimentalWarning)
            return ForeignSampler(search.sampler, made_by(**arguments))
    except Exception as error:  # whatever the sampler itself does, such as importing a package that is not there
        raise DefinitionError(
            f"sampler '{search.sampler}' cannot be made ({type(error).__name__}: {error}); check sampler_arguments and "
            "install what it needs"
        ) from error


def startup_trials(options: int, trials: int) -> int:
    """Return after how many random trials TPE begins to learn.

    Optuna begins after ten, of any number of options. With five it then settles for the wrong word of an option more
    often than with twenty (docs/performance.md); no more than a third of the budget is spent on this.
    """
    return max(_FEWEST_STARTUP, min(_STARTUP_PER_OPTION * options, trials // 3))


def _refine(space: SearchSpace, position: int, start_seed: int, seed: int) -> BaseSampler:
    if len(space.axes) == 1 and not isinstance(space.axes[0].distribution, CategoricalDistribution):
        return RefineSampler(float(space.axes[0].nominal), position)
    return RefineManySampler(space.distributions, start_seed, seed, position)


def check_search(definition: StudyDefinition, space: SearchSpace) -> None:
    """Raise `DefinitionError` where the sampler of a search cannot be made."""
    make_sampler(definition.search, 0, space)
