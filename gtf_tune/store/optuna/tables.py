"""Optuna's storage on our database; Optuna is imported only when a function here is called."""

from collections.abc import Callable, Collection, Sequence
from functools import partial
from typing import TYPE_CHECKING, TypeVar

from sqlalchemy import Table, delete

from gtf_tune.errors import OptunaStudyError
from gtf_tune.store.database import Database
from gtf_tune.store.database.engine import shared_arguments
from gtf_tune.store.database.schema import optuna_url
from gtf_tune.store.database.session import patiently, write
from gtf_tune.store.optuna.revision import optuna_revision
from gtf_tune.store.optuna.rows import STUDY_ATTRIBUTES

if TYPE_CHECKING:
    from optuna.storages import BaseStorage, RDBStorage
    from optuna.trial import FrozenTrial

Result = TypeVar("Result")


class LostRecordError(OptunaStudyError, KeyError):
    """Signal a study or a trial of Optuna that is gone, also to Optuna's own code, which expects a KeyError."""

    def __str__(self) -> str:
        return str(self.args[0])


def optuna_storage(database: Database, *, of_search: bool = False) -> "RDBStorage":
    """Return Optuna's storage on the connections of the same database, with the same tuning of transactions.

    `Database.close` closes it too. Its calls wait out faults that pass, except those that create studies and trials:
    wrap these in `with_optuna` and look first for what an earlier attempt created. A storage ``of_search`` shows only
    the trials that gtf-tune made: samplers do not learn from those that other programs put into a study.

    Raises
    ------
    StorageError
        Optuna's tables are older or newer than the installed Optuna.
    """
    from gtf_tune.store.optuna.retrying_storage import RetryingStorage

    fault = with_optuna(database, lambda: optuna_revision(database.engine).fault(database.shown_url))
    if fault is not None:
        raise fault
    return with_optuna(
        database,
        lambda: RetryingStorage(
            partial(with_optuna, database),
            optuna_url(database.url),
            of_search=of_search,
            engine_kwargs=shared_arguments(database.engine),
            # Optuna's own check opens a second connection inside a transaction, which would block on the first.
            skip_compatibility_check=True,
            skip_table_creation=True,
        ),
    )


def with_optuna(database: Database, work: Callable[[], Result]) -> Result:
    """Return what ``work`` gets from Optuna, trying again after faults of the database that may pass.

    ``work`` must be idempotent, like a unit of work of `gtf_tune.store.database.session.write`.

    Raises
    ------
    StorageError
        The fault did not pass.
    LostRecordError
        A study or a trial is gone.
    """
    from optuna.exceptions import StorageInternalError

    def attempt() -> Result:
        try:
            return work()
        except StorageInternalError as error:
            raise error.__cause__ or error from error
        except KeyError as error:
            raise LostRecordError(
                f"another program renamed or deleted an Optuna study in {database.shown_url} while it was worked on; "
                "run the command again"
            ) from error

    return patiently(database, attempt)


def trials_by_id(storage: "BaseStorage", optuna_study_id: int) -> "dict[int, FrozenTrial]":
    """Return the trials of an Optuna study by their database ids, in the order of their numbers."""
    return {trial._trial_id: trial for trial in storage.get_all_trials(optuna_study_id, deepcopy=False)}


def optuna_tables() -> list[Table]:
    """Return the tables that Optuna keeps in the database."""
    from optuna.storages._rdb.models import BaseModel

    return list(BaseModel.metadata.sorted_tables)


def forget_attributes(database: Database, optuna_study_id: int, keys: Collection[str]) -> None:
    """Remove system attributes of an Optuna study, for which Optuna itself has no call."""
    attribute = STUDY_ATTRIBUTES.c
    doomed = delete(STUDY_ATTRIBUTES).where(attribute.study_id == optuna_study_id, attribute.key.in_(keys))
    if keys:
        write(database, lambda session: session.execute(doomed).close())


def fail_trials(database: Database, trial_ids: Sequence[int]) -> None:
    """Turn Optuna's trials with these ids into failed ones, which Optuna itself does not do once they have ended."""
    from optuna.storages._rdb.models import TrialModel
    from optuna.trial import TrialState
    from sqlalchemy import update

    statement = update(TrialModel).where(TrialModel.trial_id.in_(trial_ids)).values(state=TrialState.FAIL)
    write(database, lambda session: session.execute(statement.execution_options(synchronize_session=False)).close())
