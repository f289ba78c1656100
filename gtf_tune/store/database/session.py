"""Units of work in one transaction: the only place that opens sessions and commits; and the rows that they return."""

import random
import time
from collections.abc import Callable, Iterable, Iterator
from dataclasses import fields
from typing import Any, TypeVar, cast

from sqlalchemy import Engine, Executable, Table
from sqlalchemy.exc import SQLAlchemyError
from sqlalchemy.orm import Session

from gtf_tune.store.database.errors import is_read_only, is_transient, storage_error, was_refused
from gtf_tune.store.database.handle import Database

Result = TypeVar("Result")

_GIVE_UP_AFTER_S = 120.0
_LONGEST_PAUSE_S = 5.0
_pause = time.sleep


def read(database: Database, work: Callable[[Session], Result]) -> Result:
    """Return what ``work`` reads from one consistent state of the database; see `write` for faults."""
    return patiently(database, lambda: _attempt(database.reader, work))


def read_rows(database: Database, query: Executable) -> list[tuple[Any, ...]]:
    """Return the rows that one query finds."""
    # Not by `session.execute`: columns need no treatment as objects, and thousands of rows take half as long without.
    return read(database, lambda session: [tuple(row) for row in session.connection().execute(query)])


def write(database: Database, work: Callable[[Session], Result]) -> Result:
    """Do ``work`` in one transaction and return its result, all of it or nothing.

    The unit of work is done again, for at most two minutes, after a fault that may pass: a locked database, a dropped
    connection, a server that restarts, a deadlock, a unique row that another process inserted first. So it must be
    idempotent, even when its first commit succeeded and only the answer was lost: look first, then write.

    Raises
    ------
    StorageError
        The database refused the work, or the fault did not pass.
    """
    return patiently(database, lambda: _attempt(database.engine, work))


def patiently(database: Database, attempt: Callable[[], Result]) -> Result:
    """Return what ``attempt`` returns, trying again as `write` does after a fault of the database that may pass.

    Raises
    ------
    StorageError
        The fault did not pass, or is of the other kind.
    """
    give_up_at = time.monotonic() + _GIVE_UP_AFTER_S
    pause_s = 0.05
    refusals = 0
    while True:
        try:
            result = attempt()
            database.check_in_place()
            return result
        except SQLAlchemyError as error:
            database.check_in_place()
            refusals += was_refused(error)  # once, it may be a server that was ending
            if is_read_only(error):
                database.engine.pool.dispose()  # the address may be that of another server by now
            if not is_transient(error) or refusals > 1 or time.monotonic() > give_up_at:
                raise storage_error(error, database.url) from error
        _pause(pause_s * random.uniform(0.5, 1.0))
        pause_s = min(2 * pause_s, _LONGEST_PAUSE_S)


def _attempt(engine: Engine, work: Callable[[Session], Result]) -> Result:
    with Session(engine, expire_on_commit=False) as session:
        result = work(session)
        session.commit()
        return result


Value = TypeVar("Value")
Item = TypeVar("Item")

_CHUNK = 500


def columns_of(model: type, value_type: type) -> list[Any]:
    """Return the columns of a table that fill a value, in the order of its fields."""
    return [getattr(model, field.name) for field in fields(value_type)]


def table_of(model: type) -> Table:
    """Return the table of a model, for rows that need no bookkeeping as objects."""
    return cast("Table", model.__table__)  # type: ignore[attr-defined]


def chunks(items: Iterable[Item], size: int = _CHUNK) -> Iterator[list[Item]]:
    """Yield the items in lists short enough for the parameters of one statement."""
    todo = list(items)
    for start in range(0, len(todo), size):
        yield todo[start : start + size]
