"""Optuna's storage on our database; Optuna is imported only when a function here is called."""

import warnings
from collections.abc import Callable, Collection, Sequence
from contextlib import suppress
from functools import cache, partial
from typing import TYPE_CHECKING, TypeVar

from sqlalchemy import Table, column, delete, table

from gtf_tune.errors import StorageError
from gtf_tune.store.database import Database
from gtf_tune.store.database.engine import shared_arguments
from gtf_tune.store.database.schema import optuna_url
from gtf_tune.store.database.session import patiently, write

if TYPE_CHECKING:
    from optuna.storages import BaseStorage, RDBStorage
    from optuna.trial import FrozenTrial

Result = TypeVar("Result")
_ATTRIBUTES = table("study_system_attributes", column("study_id"), column("key"))


def optuna_storage(database: Database, heartbeat_s: int | None = None, grace_s: int | None = None) -> "RDBStorage":
    """Return Optuna's storage on the connections of the same database, with the same tuning of transactions.

    `Database.close` closes it too. Its calls wait out faults that pass, except those that create studies and trials:
    wrap these in `with_optuna` and look first for what an earlier attempt created. ``heartbeat_s`` and ``grace_s`` are
    Optuna's ``heartbeat_interval`` and ``grace_period``, in seconds.

    Raises
    ------
    StorageError
        Optuna's tables are older or newer than the installed Optuna.
    """
    from optuna.exceptions import ExperimentalWarning

    from gtf_tune.store.optuna.retrying_storage import RetryingStorage

    def connect() -> "RDBStorage":
        return RetryingStorage(
            partial(with_optuna, database),
            optuna_url(database.url),
            engine_kwargs=shared_arguments(database.engine),
            # Optuna's own check opens a second connection inside a transaction, which would block on the first.
            skip_compatibility_check=True,
            heartbeat_interval=heartbeat_s,
            grace_period=grace_s,
            skip_table_creation=True,
        )

    with warnings.catch_warnings():
        warnings.simplefilter("ignore", ExperimentalWarning)
        storage = with_optuna(database, connect)
    revision = storage.get_current_version()
    if revision != _head_revision():
        raise StorageError(
            f"the Optuna tables in {database.shown_url} have revision {revision}, not {_head_revision()}; run "
            f"'gtf-tune storage upgrade --storage {database.shown_url}'"
        )
    return storage


@cache
def _head_revision() -> str:
    """Return the revision that the installed Optuna works with; it reads all its migrations to tell."""
    from optuna.storages import RDBStorage

    storage = RDBStorage("sqlite://")
    head = storage.get_head_version()
    storage.remove_session()
    storage.engine.dispose()
    return head


def with_optuna(database: Database, work: Callable[[], Result]) -> Result:
    """Return what ``work`` gets from Optuna, trying again after faults of the database that may pass.

    ``work`` must be idempotent, like a unit of work of `gtf_tune.store.database.session.write`.

    Raises
    ------
    StorageError
        The fault did not pass.
    """
    from optuna.exceptions import StorageInternalError

    def attempt() -> Result:
        try:
            return work()
        except StorageInternalError as error:
            raise error.__cause__ or error from error

    return patiently(database, attempt)


def study_ids(storage: "BaseStorage") -> set[int]:
    """Return the database ids of all Optuna studies."""
    return {study._study_id for study in storage.get_all_studies()}


def trials_by_id(storage: "BaseStorage", optuna_study_id: int) -> "dict[int, FrozenTrial]":
    """Return the trials of an Optuna study by their database ids, in the order of their numbers."""
    return {trial._trial_id: trial for trial in storage.get_all_trials(optuna_study_id, deepcopy=False)}


def optuna_tables() -> list[Table]:
    """Return the tables that Optuna keeps in the database."""
    from optuna.storages._rdb.models import BaseModel

    return list(BaseModel.metadata.sorted_tables)


def forget_attributes(database: Database, optuna_study_id: int, keys: Collection[str]) -> None:
    """Remove system attributes of an Optuna study, for which Optuna itself has no call."""
    doomed = delete(_ATTRIBUTES).where(_ATTRIBUTES.c.study_id == optuna_study_id, _ATTRIBUTES.c.key.in_(keys))
    if keys:
        write(database, lambda session: session.execute(doomed).close())


def delete_optuna_study(database: Database, optuna_study_id: int) -> None:
    """Delete an Optuna study with its trials, if it is still there."""
    with suppress(KeyError):
        with_optuna(database, lambda: optuna_storage(database).delete_study(optuna_study_id))


def fail_trials(database: Database, trial_ids: Sequence[int]) -> None:
    """Turn Optuna's trials with these ids into failed ones, which Optuna itself does not do once they have ended."""
    from optuna.storages._rdb.models import TrialModel
    from optuna.trial import TrialState
    from sqlalchemy import update

    statement = update(TrialModel).where(TrialModel.trial_id.in_(trial_ids)).values(state=TrialState.FAIL)
    write(database, lambda session: session.execute(statement.execution_options(synchronize_session=False)).close())
