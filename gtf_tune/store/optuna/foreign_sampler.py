"""Let a sampler that gtf-tune does not know search a study of ours."""

import contextlib
import copy
import warnings
from collections.abc import Iterator, Sequence
from typing import Any

import optuna
from optuna.distributions import BaseDistribution
from optuna.exceptions import OptunaError
from optuna.samplers import BaseSampler
from optuna.trial import FrozenTrial, TrialState

from gtf_tune.errors import DefinitionError, GtfTuneError
from gtf_tune.store.optuna.trials import storage_of


class ForeignSampler(BaseSampler):
    """Any sampler of Optuna's kind, shown the study in the form that it can learn from.

    It sees infeasible trials with the worst feasible score; their constraint says how far out they lie. Their penalty
    is hundreds of times as large, and beside it a Gaussian process takes all feasible scores for equal. Only the budget
    ends a study, whatever the sampler thinks. What goes wrong inside of it is a `DefinitionError` that names it.
    """

    def __init__(self, name: str, sampler: BaseSampler) -> None:
        self._name = name
        self._sampler = sampler
        self._shown: tuple[optuna.Study, optuna.Study] | None = None

    def infer_relative_search_space(self, study: optuna.Study, trial: FrozenTrial) -> dict[str, BaseDistribution]:
        """Return the options that the sampler chooses together."""
        with self._faults_named():
            return self._sampler.infer_relative_search_space(self._show(study), trial)

    def sample_relative(
        self, study: optuna.Study, trial: FrozenTrial, search_space: dict[str, BaseDistribution]
    ) -> dict[str, Any]:
        """Return values for these options."""
        with self._faults_named():
            return self._sampler.sample_relative(self._show(study), trial, search_space)

    def sample_independent(
        self, study: optuna.Study, trial: FrozenTrial, param_name: str, param_distribution: BaseDistribution
    ) -> Any:
        """Return a value for one option."""
        with self._faults_named():
            return self._sampler.sample_independent(self._show(study), trial, param_name, param_distribution)

    def before_trial(self, study: optuna.Study, trial: FrozenTrial) -> None:
        """Pass the begin of a trial on."""
        with self._faults_named():
            self._sampler.before_trial(self._show(study), trial)

    def after_trial(
        self, study: optuna.Study, trial: FrozenTrial, state: TrialState, values: Sequence[float] | None
    ) -> None:
        """Pass the end of a trial on."""
        with self._faults_named(), warnings.catch_warnings():
            # Said by samplers that go by values alone, which tell infeasible trials by theirs.
            warnings.filterwarnings("ignore", message="Constraints have been set")
            self._sampler.after_trial(self._show(study), trial, state, values)

    @contextlib.contextmanager
    def _faults_named(self) -> Iterator[None]:
        try:
            yield
        except (OptunaError, GtfTuneError):  # of the storage; whoever works on the trial knows what to do
            raise
        except Exception as error:
            raise DefinitionError(
                f"sampler '{self._name}' failed ({type(error).__name__}: {error}); check its arguments and what its "
                "documentation says of such search spaces, or take another sampler"
            ) from error

    def _show(self, study: optuna.Study) -> optuna.Study:
        if self._shown is None or self._shown[0] is not study:
            storage: Any = _ShownStorage(storage_of(study))
            self._shown = study, _ShownStudy(study.study_name, storage, self, study.pruner)
        return self._shown[1]


class _ShownStudy(optuna.Study):
    def stop(self) -> None:
        """Do nothing: samplers that have tried all they know would end the study, which no study of ours lets them."""


class _ShownStorage:
    """A storage whose trials carry no penalties."""

    def __init__(self, storage: Any) -> None:
        self._storage = storage

    def __getattr__(self, name: str) -> Any:
        return getattr(self._storage, name)

    def get_all_trials(self, study_id: int, deepcopy: bool = True, states: Any = None) -> list[FrozenTrial]:
        """Return the trials of a study in these states, all where there are none given."""
        return without_penalties(self._storage.get_all_trials(study_id, deepcopy, states))


def without_penalties(trials: list[FrozenTrial]) -> list[FrozenTrial]:
    """Return the trials with the worst feasible value in place of penalties; as they are where none is feasible."""
    complete = [trial for trial in trials if trial.state == TrialState.COMPLETE and trial.value is not None]
    values = [trial.value for trial in complete if _is_feasible(trial) and trial.value is not None]
    if not values:
        return trials
    penalised = {trial.number for trial in complete if not _is_feasible(trial)}
    return [_with_value(trial, max(values)) if trial.number in penalised else trial for trial in trials]


def _is_feasible(trial: FrozenTrial) -> bool:
    return all(violation <= 0 for violation in trial.constraints.values())


def _with_value(trial: FrozenTrial, value: float) -> FrozenTrial:
    copied = copy.copy(trial)
    copied.value = value
    return copied
