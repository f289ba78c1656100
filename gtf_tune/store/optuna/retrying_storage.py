"""Optuna's storage, trying again after faults of the database that pass, as our own sessions do."""

import functools
import json
import threading
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from types import MappingProxyType
from typing import Any, cast

from optuna.distributions import BaseDistribution, distribution_to_json
from optuna.storages import BaseStorage, RDBStorage
from optuna.storages._rdb import models
from optuna.storages._rdb.storage import _create_scoped_session
from optuna.trial import FrozenTrial, TrialState
from sqlalchemy import Select, select
from sqlalchemy.dialects import postgresql, sqlite
from sqlalchemy.orm import Session

from gtf_tune.store.database.models import Study, Trial
from gtf_tune.store.optuna.rows import NUMBER_KEY

# All of these may be done twice: they look, or set what a second call sets again. `create_new_trial` may, too, where
# the trial has such a number.
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

Retry = Callable[[Callable[[], Any]], Any]
"""Return what a call returns, calling it again after faults that pass."""

_Row = tuple[Any, dict[str, Any]]
"""A model of Optuna and the columns of one of its rows."""

_KEPT = MappingProxyType(
    {
        models.TrialUserAttributeModel: "key",
        models.TrialSystemAttributeModel: "key",
        models.TrialIntermediateValueModel: "step",
        models.TrialParamModel: "param_name",
    }
)
"""What can be gathered, each with the column that tells the rows of a trial apart."""

_UPSERTS: Mapping[str, Any] = MappingProxyType({"sqlite": sqlite.insert, "postgresql": postgresql.insert})


class _Gathered(threading.local):
    """Rows that a thread has set but not yet written; ``None`` where it writes at once."""

    rows: list[_Row] | None = None


class RetryingStorage(RDBStorage):
    """Repeat calls that failed because of a lock, a dropped connection or a restarting server, by ``retry``.

    A number has one unfinished trial at any time: creating it again returns the one that is there. Optuna itself
    creates a second one when the answer to its commit is lost, and so does a worker that was cut off while another took
    its trial over.

    With ``of_search``, trials that gtf-tune did not make are left out of lists.

    Raises `StorageError` where the fault does not pass, and `LostRecordError` where a study or a trial is gone.
    """

    def __init__(self, retry: Retry, url: str, *, of_search: bool = False, **arguments: Any) -> None:
        super().__init__(url, **arguments)
        self._of_search = of_search
        self._gathered = _Gathered()
        self._gather = _retried(retry, self._write_gathered)
        for name in _REPEATABLE:
            setattr(self, name, _retried(retry, getattr(self, name)))

    @contextmanager
    def gathered(self) -> Iterator[None]:
        """Write what this thread sets of trials meanwhile in one transaction at the end: options, attributes, values.

        Nothing is written where an exception ends it.
        """
        rows: list[_Row] = []
        self._gathered.rows = rows
        try:
            yield
        finally:
            self._gathered.rows = None
        if rows:
            self._gather(rows)

    def _write_gathered(self, rows: Sequence[_Row]) -> None:
        upsert = _UPSERTS[self.engine.dialect.name]
        with _create_scoped_session(self.scoped_session, True) as session:
            for trial_id in {row["trial_id"] for _, row in rows}:
                trial = models.TrialModel.find_or_raise_by_id(trial_id, session)
                self.check_trial_is_updatable(trial_id, cast("TrialState", trial.state))
            for kind, name in _KEPT.items():
                mine = {(row["trial_id"], row[name]): row for model, row in rows if model is kind}
                if not mine:
                    continue
                insert = upsert(kind).values(list(mine.values()))
                if kind is models.TrialParamModel:  # a worker that was cut off must not change what another has chosen
                    session.execute(insert.on_conflict_do_nothing(index_elements=["trial_id", name]))
                    continue
                changed = {column: insert.excluded[column] for column in next(iter(mine.values()))}
                session.execute(insert.on_conflict_do_update(index_elements=["trial_id", name], set_=changed))

    def _set_trial_param(
        self,
        trial_id: int,
        param_name: str,
        param_value_internal: float,
        distribution: BaseDistribution,
        previous_distribution: BaseDistribution | None,
    ) -> None:
        if self._gathered.rows is None:
            super()._set_trial_param(trial_id, param_name, param_value_internal, distribution, previous_distribution)
            return
        row = {"param_value": param_value_internal, "distribution_json": distribution_to_json(distribution)}
        self._gathered.rows.append((models.TrialParamModel, {"trial_id": trial_id, "param_name": param_name, **row}))

    def set_trial_user_attr(self, trial_id: int, key: str, value: Any) -> None:
        """Set a user attribute now, or with all others that are gathered."""
        if not self._gathers(models.TrialUserAttributeModel, trial_id, key, value):
            super().set_trial_user_attr(trial_id, key, value)

    def set_trial_system_attr(self, trial_id: int, key: str, value: Any) -> None:
        """Set a system attribute now, or with all others that are gathered."""
        if not self._gathers(models.TrialSystemAttributeModel, trial_id, key, value):
            super().set_trial_system_attr(trial_id, key, value)

    def _gathers(self, kind: Any, trial_id: int, key: str, value: Any) -> bool:
        """Keep an attribute for later and return True, where this thread gathers."""
        if self._gathered.rows is None:
            return False
        self._gathered.rows.append((kind, {"trial_id": trial_id, "key": key, "value_json": json.dumps(value)}))
        return True

    def set_trial_intermediate_value(self, trial_id: int, step: int, intermediate_value: float) -> None:
        """Set an intermediate value now, or with all others that are gathered."""
        if self._gathered.rows is None:
            super().set_trial_intermediate_value(trial_id, step, intermediate_value)
            return
        kind = models.TrialIntermediateValueModel
        value, value_type = kind.intermediate_value_to_stored_repr(intermediate_value)
        row = {"intermediate_value": value, "intermediate_value_type": value_type}
        self._gathered.rows.append((kind, {"trial_id": trial_id, "step": step, **row}))

    def _get_trials(self, study_id: int, *arguments: Any, **named: Any) -> list[FrozenTrial]:
        """Return trials of a study; those of a search are the ones that the trials of its budget name, or wait to."""
        found = super()._get_trials(study_id, *arguments, **named)
        if not self._of_search:
            return found
        with _create_scoped_session(self.scoped_session) as session:
            ours = set(session.scalars(_attached(study_id)))
        return [
            trial
            for trial in found
            if trial._trial_id in ours or (NUMBER_KEY in trial.system_attrs and not trial.state.is_finished())
        ]

    def _get_prepared_new_trial(
        self, study_id: int, template_trial: FrozenTrial | None, session: Session
    ) -> models.TrialModel:
        """Return the unfinished trial of the template's number, or a new one; the study's row is locked by now."""
        number = template_trial.system_attrs.get(NUMBER_KEY) if template_trial else None
        found = None if number is None else session.scalars(_of_number(study_id, number)).first()
        return found or super()._get_prepared_new_trial(study_id, template_trial, session)


@contextmanager
def gathered(storage: BaseStorage) -> Iterator[None]:
    """Write what this thread sets of trials meanwhile in one transaction (see `RetryingStorage.gathered`).

    ``storage`` is that of an Optuna study, whose cache of finished trials passes such calls on to ours.
    """
    ours = getattr(storage, "_backend", storage)
    if not isinstance(ours, RetryingStorage):
        yield
        return
    with ours.gathered():
        yield


def _attached(study_id: int) -> Select[int | None]:
    """Select the ids of the Optuna trials that the trials of a study's budget name."""
    return (
        select(Trial.optuna_trial_id)
        .join(Study, Study.id == Trial.study_id)
        .where(Study.optuna_study_id == study_id, Trial.optuna_trial_id.is_not(None))
    )


def _of_number(study_id: int, number: int) -> Select[models.TrialModel]:
    trial, attribute = models.TrialModel, models.TrialSystemAttributeModel
    return (
        select(trial)
        .join(attribute, attribute.trial_id == trial.trial_id)
        .where(trial.study_id == study_id, trial.state.in_([TrialState.WAITING, TrialState.RUNNING]))
        .where(attribute.key == NUMBER_KEY, attribute.value_json == json.dumps(number))
        .order_by(trial.number)
    )


def _retried(retry: Retry, call: Callable[..., Any]) -> Callable[..., Any]:
    @functools.wraps(call)
    def retried(*arguments: Any, **named: Any) -> Any:
        return retry(lambda: call(*arguments, **named))

    return retried
