"""Optuna's trials, one for each trial of a study's budget."""

from collections.abc import Mapping
from contextlib import suppress
from dataclasses import dataclass
from types import MappingProxyType
from typing import Any

import optuna
from optuna.exceptions import UpdateFinishedTrialError
from optuna.storages import BaseStorage
from optuna.trial import FrozenTrial, Trial, TrialState, create_trial

from gtf_tune.store.optuna.rows import NUMBER_KEY

_FIXED = "fixed_params"  # where Optuna's own enqueue_trial keeps the values that a trial must take
STATES = MappingProxyType({"complete": TrialState.COMPLETE, "pruned": TrialState.PRUNED})


def create_for_number(study: optuna.Study, number: int, fixed: Mapping[str, Any] | None) -> int:
    """Create the waiting Optuna trial of a number, unless an earlier worker has, and return its id.

    ``fixed`` are values that it must take; ``None`` lets the sampler choose.
    """
    template = create_trial(
        state=TrialState.WAITING,
        system_attrs={NUMBER_KEY: number, **({_FIXED: dict(fixed)} if fixed is not None else {})},
    )
    return storage_of(study).create_new_trial(study_id_of(study), template_trial=template)


def fixed_options(study: optuna.Study, trial_id: int) -> dict[str, Any]:
    """Return the values that an enqueued trial must take."""
    return dict(frozen(study, trial_id).system_attrs.get(_FIXED, {}))


def refuse(study: optuna.Study, trial_id: int, reason: str) -> None:
    """Let an enqueued trial fail, with the reason in its user attribute ``refused``."""
    storage = storage_of(study)
    with suppress(UpdateFinishedTrialError):
        storage.set_trial_user_attr(trial_id, "refused", reason)
        storage.set_trial_state_values(trial_id, TrialState.FAIL)


def start(study: optuna.Study, trial_id: int) -> Trial:
    """Return the running trial of an id; a trial that another worker has begun is continued with the same options.

    The sampler learns from all trials that have ended by now: like `Study.ask`, which is not used here, this drops the
    list of trials that Optuna keeps for each thread. Samplers such as TPE would else see that of their first trial for
    ever.

    Raises
    ------
    UpdateFinishedTrialError
        Another worker has finished it.
    """
    storage_of(study).set_trial_state_values(trial_id, state=TrialState.RUNNING)
    study._thread_local.cached_all_trials = None
    return Trial(study, trial_id)


def known(trial: Trial) -> FrozenTrial:
    """Return what a running trial had when it was begun here, with what it was given since."""
    return trial._cached_frozen_trial


def frozen(study: optuna.Study, trial_id: int) -> FrozenTrial:
    """Return a trial as the database has it."""
    return storage_of(study).get_trial(trial_id)


def is_finished(study: optuna.Study, trial_id: int) -> bool:
    """Return True if a trial has its final state."""
    return frozen(study, trial_id).state.is_finished()


def storage_of(study: optuna.Study) -> BaseStorage:
    """Return the storage of a study."""
    return study._storage


def study_id_of(study: Any) -> int:
    """Return the database id of an `optuna.Study`, or of the frozen one that a storage returns."""
    return int(study._study_id)


@dataclass(frozen=True)
class TrialHandle:
    """Name of a trial for functions that take an `optuna.Trial`, which to make would involve the sampler."""

    study: optuna.Study
    storage: BaseStorage
    _trial_id: int


def tell(study: optuna.Study, number: int, value: float, state: str = "complete") -> None:
    """Give a trial its final value and state, "complete" or "pruned"; a trial that already has them keeps them.

    `Study.tell` would give a pruned trial its last intermediate value, which here is that of one noise instance.
    """
    storage = storage_of(study)
    trial_id = storage.get_trial_id_from_study_id_trial_number(study_id_of(study), number)
    with suppress(UpdateFinishedTrialError):
        storage.set_trial_state_values(trial_id, STATES[state], [value])
