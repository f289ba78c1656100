"""Give Optuna a storage on our database; Optuna is imported only when a function here is called."""

import warnings
from collections.abc import Callable, Collection
from contextlib import suppress
from functools import cache
from typing import TYPE_CHECKING, TypeVar

from sqlalchemy import column, delete, table

from gtf_tune.errors import StorageError
from gtf_tune.store.database import Database
from gtf_tune.store.database.engine import shared_arguments
from gtf_tune.store.database.schema import optuna_url
from gtf_tune.store.database.session import patiently, write

if TYPE_CHECKING:
    from optuna.storages import RDBStorage

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

    from gtf_tune.store.optuna.retrying_storage import PatientStorage

    def connect() -> "RDBStorage":
        return PatientStorage(
            database,
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


def forget_attributes(database: Database, optuna_study_id: int, keys: Collection[str]) -> None:
    """Remove system attributes of an Optuna study, for which Optuna itself has no call."""
    doomed = delete(_ATTRIBUTES).where(_ATTRIBUTES.c.study_id == optuna_study_id, _ATTRIBUTES.c.key.in_(keys))
    if keys:
        write(database, lambda session: session.execute(doomed).close())


def delete_optuna_study(database: Database, optuna_study_id: int) -> None:
    """Delete an Optuna study with its trials, if it is still there."""
    with suppress(KeyError):
        with_optuna(database, lambda: optuna_storage(database).delete_study(optuna_study_id))
