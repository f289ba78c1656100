"""Give Optuna a storage on our database; Optuna is imported only when a function here is called."""

import warnings
from contextlib import suppress
from typing import TYPE_CHECKING

from gtf_tune.errors import StorageError
from gtf_tune.store.database import Database
from gtf_tune.store.engine import shared_arguments
from gtf_tune.store.schema import optuna_url

if TYPE_CHECKING:
    from optuna.storages import RDBStorage


def optuna_storage(database: Database, heartbeat_s: int | None = None, grace_s: int | None = None) -> "RDBStorage":
    """Return Optuna's storage on the connections of the same database, with the same tuning of transactions.

    `Database.close` closes it too. ``heartbeat_s`` and ``grace_s`` are Optuna's ``heartbeat_interval`` and
    ``grace_period``, in seconds.

    Raises
    ------
    StorageError
        Optuna's tables are older or newer than the installed Optuna.
    """
    from optuna.exceptions import ExperimentalWarning
    from optuna.storages import RDBStorage

    with warnings.catch_warnings():
        warnings.simplefilter("ignore", ExperimentalWarning)
        storage = RDBStorage(
            optuna_url(database.url),
            engine_kwargs=shared_arguments(database.engine),
            # Optuna's own check opens a second connection inside a transaction, which would block on the first.
            skip_compatibility_check=True,
            heartbeat_interval=heartbeat_s,
            grace_period=grace_s,
            skip_table_creation=True,
        )
    if storage.get_current_version() != storage.get_head_version():
        raise StorageError(
            f"the Optuna tables in {database.shown_url} have revision {storage.get_current_version()}, not "
            f"{storage.get_head_version()}; run 'gtf-tune storage upgrade --storage {database.shown_url}'"
        )
    return storage


def delete_optuna_study(database: Database, optuna_study_id: int) -> None:
    """Delete an Optuna study with its trials, if it is still there."""
    with suppress(KeyError):
        optuna_storage(database).delete_study(optuna_study_id)
