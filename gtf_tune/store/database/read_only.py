"""Open SQLite files that this user cannot write to: without write permission, in such a folder, on a read-only disk."""

import os
import sqlite3
from contextlib import closing
from pathlib import Path

from gtf_tune.errors import StorageError

_READING_VERSION_AT = 19
_WRITE_AHEAD = 2


class ReadOnlyConnection(sqlite3.Connection):
    """Connection to a SQLite file that can only be read."""


def can_write(path: Path) -> bool:
    """Return whether SQLite can write to a file, for which it needs files of its own beside it.

    A file that does not exist counts as one that it can make.
    """
    if not path.exists():
        return True
    return _may_write(path) and (
        _may_write(path.absolute().parent) or (_may_write(_beside(path, "wal")) and _may_write(_beside(path, "shm")))
    )


def connect_read_only(path: Path, timeout_s: float) -> ReadOnlyConnection:
    """Return a connection that changes neither the file nor its folder.

    SQLite reads a file in write-ahead mode only together with ``-wal`` and ``-shm`` files. Where nobody has left them
    and this user cannot make them, the file is complete without, and is opened as one that nobody changes.

    Raises
    ------
    StorageError
        There are changes in the ``-wal`` file that cannot be read without writing to the folder.
    """
    alone = _is_write_ahead(path) and not (_size(_beside(path, "wal")) or _beside(path, "shm").exists())
    uri = f"{path.absolute().as_uri()}?mode=ro{'&immutable=1' if alone else ''}"
    connection = sqlite3.connect(uri, uri=True, timeout=timeout_s, check_same_thread=False, factory=ReadOnlyConnection)
    try:
        with closing(connection.execute("PRAGMA schema_version")) as cursor:
            cursor.fetchone()
    except sqlite3.OperationalError as error:
        connection.close()
        wal = _beside(path, "wal")
        if _size(wal):
            raise StorageError(
                f"{path} cannot be read here, because its last changes are still in {wal.name} and you cannot write "
                f"to its folder; copy {path.name} and {wal.name} to a folder of yours and work on the copy"
            ) from error
        raise
    return connection


def _may_write(path: Path) -> bool:
    return os.access(path, os.W_OK, effective_ids=os.access in os.supports_effective_ids)


def _beside(path: Path, suffix: str) -> Path:
    return path.with_name(f"{path.name}-{suffix}")


def _size(path: Path) -> int:
    return path.stat().st_size if path.exists() else 0


def _is_write_ahead(path: Path) -> bool:
    """Return whether the header says that reading the file needs a write-ahead log."""
    with path.open("rb") as file:
        header = file.read(_READING_VERSION_AT + 1)
    return header[_READING_VERSION_AT:] == bytes([_WRITE_AHEAD])
