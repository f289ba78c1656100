"""Make Optuna's storage wait out the faults of a database that pass, as our own sessions do."""

import functools
import json
from collections.abc import Callable
from typing import Any

from optuna.storages import RDBStorage
from optuna.storages._rdb import models
from optuna.trial import FrozenTrial, TrialState
from sqlalchemy import Select, select
from sqlalchemy.orm import Session

from gtf_tune.store.database import Database
from gtf_tune.store.optuna_tables import with_optuna

SLOT_KEY = "gtf_tune:slot"
"""System attribute that says which slot of a study's budget a trial belongs to."""

# All of these may be done twice: they look, or set what a second call sets again. `create_new_trial` may, too, where
# the trial names its slot.
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

    A slot has one trial at any time: creating it again returns the one that is there. Optuna itself creates a second
    one when the answer to its commit is lost, and so does a worker that was cut off while another took its slot over.

    Raises `StorageError` where the fault does not pass.
    """

    def __init__(self, database: Database, url: str, **arguments: Any) -> None:
        super().__init__(url, **arguments)
        for name in _REPEATABLE:
            setattr(self, name, _patient(database, getattr(self, name)))

    def _get_prepared_new_trial(
        self, study_id: int, template_trial: FrozenTrial | None, session: Session
    ) -> models.TrialModel:
        """Return the unfinished trial of the template's slot, or a new one; the study's row is locked by now."""
        slot = template_trial.system_attrs.get(SLOT_KEY) if template_trial else None
        found = None if slot is None else session.scalars(_of_slot(study_id, slot)).first()
        return found or super()._get_prepared_new_trial(study_id, template_trial, session)


def _of_slot(study_id: int, slot: int) -> Select[models.TrialModel]:
    trial, attribute = models.TrialModel, models.TrialSystemAttributeModel
    return (
        select(trial)
        .join(attribute, attribute.trial_id == trial.trial_id)
        .where(trial.study_id == study_id, trial.state.in_([TrialState.WAITING, TrialState.RUNNING]))
        .where(attribute.key == SLOT_KEY, attribute.value_json == json.dumps(slot))
        .order_by(trial.number)
    )


def _patient(database: Database, call: Callable[..., Any]) -> Callable[..., Any]:
    @functools.wraps(call)
    def repeated(*arguments: Any, **named: Any) -> Any:
        return with_optuna(database, lambda: call(*arguments, **named))

    return repeated
