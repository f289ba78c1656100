"""Make Optuna's storage wait out the faults of a database that pass, as our own sessions do."""

import functools
from collections.abc import Callable
from typing import Any

from optuna.storages import RDBStorage

from gtf_tune.store.database import Database
from gtf_tune.store.optuna_tables import with_optuna

# All of these may be done twice: they look, or set what a second call sets again. `create_new_trial` may not; who
# calls it looks first for the trial of an earlier attempt (`gtf_tune.study.optuna_trials.create_for_slot`).
_REPEATABLE = (
    "get_all_studies",
    "get_study_id_from_name",
    "get_study_name_from_id",
    "get_study_directions",
    "get_study_user_attrs",
    "get_study_system_attrs",
    "set_study_user_attr",
    "set_study_system_attr",
    "get_trial",
    "get_all_trials",
    "_get_trials",
    "_get_best_trial_id",
    "get_n_trials",
    "get_trial_id_from_study_id_trial_number",
    "set_trial_param",
    "_set_trial_param",
    "set_trial_state_values",
    "set_trial_intermediate_value",
    "set_trial_user_attr",
    "set_trial_system_attr",
    "record_heartbeat",
    "get_current_version",
)


class PatientStorage(RDBStorage):
    """Repeat calls that failed for a lock, a dropped connection or a restarting server, for at most two minutes.

    Raises `StorageError` where the fault does not pass.
    """

    def __init__(self, database: Database, url: str, **arguments: Any) -> None:
        super().__init__(url, **arguments)
        for name in _REPEATABLE:
            setattr(self, name, _patient(database, getattr(self, name)))


def _patient(database: Database, call: Callable[..., Any]) -> Callable[..., Any]:
    @functools.wraps(call)
    def repeated(*arguments: Any, **named: Any) -> Any:
        return with_optuna(database, lambda: call(*arguments, **named))

    return repeated
