"""Turn the faults of databases into `StorageError`, by their codes and never by their text."""

import sqlite3
from sqlite3 import (
    SQLITE_BUSY,
    SQLITE_CANTOPEN,
    SQLITE_CONSTRAINT_PRIMARYKEY,
    SQLITE_CONSTRAINT_UNIQUE,
    SQLITE_CORRUPT,
    SQLITE_FULL,
    SQLITE_IOERR,
    SQLITE_LOCKED,
    SQLITE_NOTADB,
    SQLITE_READONLY,
)

from sqlalchemy.engine import URL
from sqlalchemy.exc import DBAPIError, OperationalError, PendingRollbackError, SQLAlchemyError

from gtf_tune.errors import StorageError, UnreachableError
from gtf_tune.store.database.engine import display_url, without_passwords

_PRIMARY_CODE = 0xFF

_SQLITE_ADVICE = {
    SQLITE_BUSY: "is locked by another process; wait for it or stop it, then run the command again",
    SQLITE_LOCKED: "is locked by another process; wait for it or stop it, then run the command again",
    SQLITE_CANTOPEN: "cannot be opened; check that its folder exists and that you may write there",
    SQLITE_CORRUPT: "is damaged; restore a backup (storage/README.md)",
    SQLITE_FULL: "could not be written because the disk is full; free some space, then resume",
    SQLITE_IOERR: "could not be read or written by the operating system; check the disk, then resume",
    SQLITE_NOTADB: "is not a SQLite database; choose another storage",
    SQLITE_READONLY: (
        "cannot be written to; get write permission for the file and its folder, or copy the file to a folder of yours "
        "and work on the copy"
    ),
}

# PostgreSQL's classes of errors: https://www.postgresql.org/docs/current/errcodes-appendix.html
_CONNECTION_LOST = "08"
_ROLLED_BACK = "40"
_OPERATOR_INTERVENTION = "57"
_OUT_OF_RESOURCES = "53"
_DISK_FULL = "53100"
_UNIQUE_VIOLATION = "23505"
_LOCK_NOT_AVAILABLE = "55P03"
_IDLE_TRANSACTION_ENDED = "25P03"
_QUERY_CANCELED = "57014"
_READ_ONLY = ("25006", "0A000")  # what a server says to writers that has become a standby, or is one


def is_transient(error: SQLAlchemyError) -> bool:
    """Return True if the same unit of work may succeed when it is done again.

    So it may after a lock, a dropped connection or a deadlock, and after another process inserted the same unique row:
    the unit then finds that row. Optuna may go on in a session whose connection was dropped; SQLAlchemy then refuses
    every request.
    """
    if isinstance(error, PendingRollbackError):
        return True
    if not isinstance(error, DBAPIError):
        return False
    if isinstance(error.orig, sqlite3.Error):
        code = _sqlite_code(error)
        unique = code in (SQLITE_CONSTRAINT_UNIQUE, SQLITE_CONSTRAINT_PRIMARYKEY)
        return unique or code & _PRIMARY_CODE in (SQLITE_BUSY, SQLITE_LOCKED)
    state = _sql_state(error)
    # Without a state the fault arose before the server could answer: it is starting, stopping or out of reach.
    unanswered = not state and isinstance(error, OperationalError)
    return error.connection_invalidated or unanswered or _is_transient_state(state)


def is_read_only(error: SQLAlchemyError) -> bool:
    """Return True if the server takes no writes because another one has taken its place, or is about to."""
    return isinstance(error, DBAPIError) and _sql_state(error) in _READ_ONLY


def was_refused(error: SQLAlchemyError) -> bool:
    """Return True if a connection could not be made although the server asked who we are: a wrong password, mostly."""
    attempt = getattr(error.orig, "pgconn", None) if isinstance(error, DBAPIError) else None
    return attempt is not None and bool(attempt.needs_password or attempt.used_password)


def _is_transient_state(state: str) -> bool:
    if state in (_DISK_FULL, _QUERY_CANCELED):
        return False
    return state in (_UNIQUE_VIOLATION, _LOCK_NOT_AVAILABLE, _IDLE_TRANSACTION_ENDED, *_READ_ONLY) or state.startswith(
        (_CONNECTION_LOST, _ROLLED_BACK, _OPERATOR_INTERVENTION, _OUT_OF_RESOURCES)
    )


def storage_error(error: SQLAlchemyError, url: URL) -> StorageError:
    """Return the sentence that a user reads for a fault of the database, without any password."""
    shown = display_url(url)
    cause = error.orig if isinstance(error, DBAPIError) else error
    if isinstance(error, DBAPIError) and isinstance(cause, sqlite3.Error):
        advice = _SQLITE_ADVICE.get(_sqlite_code(error) & _PRIMARY_CODE)
        if advice is not None:
            return StorageError(f"{shown} {advice}", remedy=("storage",) if advice.endswith("storage") else ())
    if isinstance(error, DBAPIError) and _sql_state(error) == _DISK_FULL:
        return StorageError(f"{shown} could not be written because the server's disk is full; free some space there")
    said = " ".join(without_passwords(str(cause), url).split())
    if was_refused(error):
        return StorageError(
            f"{shown} refuses the user, the password or the name of the database: {said}; correct the URL or the place "
            "that holds the password (PGPASSWORD, ~/.pgpass)"
        )
    if not isinstance(cause, sqlite3.Error) and is_transient(error):
        return UnreachableError(
            f"no connection to {shown}: {said}; check that the server runs and that you may connect"
        )
    return StorageError(f"{shown} refused a request: {said}; check the storage", remedy=("check",))


def _sqlite_code(error: DBAPIError) -> int:
    return int(getattr(error.orig, "sqlite_errorcode", 0) or 0)


def _sql_state(error: DBAPIError) -> str:
    return str(getattr(error.orig, "sqlstate", None) or "")
