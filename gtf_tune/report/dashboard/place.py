"""Where optuna-dashboard's files lie, and which process may write its content."""

import fcntl
import os
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

from optuna.artifacts import FileSystemArtifactStore
from sqlalchemy import text
from sqlalchemy.exc import DBAPIError

from gtf_tune.store.database import Database

_ADVISORY_LOCK = 0x6774_6674 << 32
_PAUSE_S = 0.05


def artifact_folder(database: Database, given: Path | None = None) -> Path | None:
    """Return the folder of artifacts: the given one, or ``FILE-artifacts`` beside a SQLite file; None for a server."""
    if given is not None or database.url.get_backend_name() != "sqlite":
        return given
    path = Path(str(database.url.database))
    return path.with_name(f"{path.name}-artifacts")


def artifact_store(folder: Path | None) -> FileSystemArtifactStore | None:
    """Return Optuna's store for a folder, which is made if need be; None where there is none.

    Raises
    ------
    OSError
        The folder cannot be made.
    """
    if folder is None:
        return None
    folder.mkdir(parents=True, exist_ok=True)
    return FileSystemArtifactStore(folder)


@contextmanager
def turn_to_write(database: Database, study_id: int, patience_s: float = 0.0) -> Iterator[bool]:
    """Take the lock on the dashboard's content of a study for the length of a context; yield whether it was free.

    Waits at most ``patience_s``. A process that dies loses the lock. On SQLite the lock is on the folder of the file:
    a second handle of the file itself would drop SQLite's own locks.
    """
    if database.url.get_backend_name() == "sqlite":
        with _locked_folder(Path(str(database.url.database)).resolve().parent, patience_s) as mine:
            yield mine
        return
    key = _ADVISORY_LOCK + study_id
    with database.engine.execution_options(isolation_level="AUTOCOMMIT").connect() as connection:
        take = text("SELECT pg_try_advisory_lock(:key)")
        mine = _within(patience_s, lambda: bool(connection.scalar(take, {"key": key})))
        try:
            yield mine
        finally:
            if mine:
                with suppress(DBAPIError):  # a server that dropped the connection has released the lock already
                    connection.execute(text("SELECT pg_advisory_unlock(:key)"), {"key": key})


@contextmanager
def _locked_folder(folder: Path, patience_s: float) -> Iterator[bool]:
    handle = os.open(folder, os.O_RDONLY)
    try:
        yield _within(patience_s, lambda: _try_lock(handle))
    finally:
        os.close(handle)


def _try_lock(handle: int) -> bool:
    try:
        fcntl.flock(handle, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except BlockingIOError:
        return False
    return True


def _within(patience_s: float, attempt: Callable[[], bool]) -> bool:
    give_up_at = time.monotonic() + patience_s
    while not attempt():
        if time.monotonic() >= give_up_at:
            return False
        time.sleep(_PAUSE_S)
    return True
