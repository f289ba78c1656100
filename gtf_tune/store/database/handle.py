"""Open, create and upgrade the database that holds studies."""

import time
from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Self, TypeVar

from sqlalchemy import Engine
from sqlalchemy.engine import URL
from sqlalchemy.exc import SQLAlchemyError

from gtf_tune.errors import StorageError, UnreachableError
from gtf_tune.store.database.backup import back_up
from gtf_tune.store.database.engine import READ_ONLY, can_write, display_url, make_engine, parse_url
from gtf_tune.store.database.errors import storage_error
from gtf_tune.store.database.schema import REVISIONS, check_revision, create_schema, current_revision, upgrade_schema
from gtf_tune.store.optuna.revision import optuna_revision

Result = TypeVar("Result")

PATIENCE_S = 60.0
_KNOCK_S = 2.0


@dataclass(frozen=True, eq=False)
class Database:
    """The connections of one process to one database; every other process opens its own.

    ``engine`` writes. ``reader`` shares its connections, sees one consistent state per transaction and, on SQLite, does
    not wait for writers. Safe to use from several threads.
    """

    url: URL = field(repr=False)
    engine: Engine = field(repr=False)
    reader: Engine = field(repr=False)
    file: "_File | None" = field(default=None, repr=False)

    def check_in_place(self) -> None:
        """Raise `StorageError` if a SQLite file was removed, moved or replaced since it was opened.

        What is written then is lost with the process, or lies in a file of another name.
        """
        if self.file is not None and _File.at(self.file.path) != self.file:
            raise StorageError(
                f"{self.shown_url} was removed, moved or replaced while it was in use, and what was stored since may "
                "be missing; put the file back, with its -wal and -shm files, then resume"
            )

    @property
    def shown_url(self) -> str:
        """Return the URL for messages, without passwords."""
        return display_url(self.url)

    @property
    def is_shared(self) -> bool:
        """Whether other machines may use it: no file of SQLite, whose locks do not hold across machines."""
        return self.engine.dialect.name != "sqlite"

    def close(self) -> None:
        """Close the connections that are not in use."""
        self.engine.dispose()


def open_database(storage: str) -> Database:
    """Return a database that exists and has the tables of this version.

    Raises
    ------
    StorageError
        It does not exist, is no database, cannot be reached, or its tables are older or newer than this version.
    """
    database = connect(storage)
    return _current(database)


def wait_for_database(
    storage: str, announce: Callable[[str], None] = lambda _: None, patience_s: float = PATIENCE_S
) -> Database:
    """Return what `open_database` does, as soon as the server answers: it may be restarting; ``announce`` says so.

    Raises
    ------
    StorageError
        The server did not answer for ``patience_s`` seconds, or the fault is of another kind.
    """
    give_up_at = time.monotonic() + patience_s
    patient = False
    while True:
        try:
            return open_database(storage)
        except UnreachableError as error:
            if time.monotonic() > give_up_at:
                raise
            if not patient:
                announce(f"{error}; trying again for {patience_s:g} s")
            patient = True
        time.sleep(_KNOCK_S)


def create_database(storage: str) -> Database:
    """Return a database with all tables, after making them where there are none; many processes may do so at once.

    Raises
    ------
    StorageError
        It cannot be created or reached, or its tables are older or newer than this version.
    """
    url = parse_url(storage)
    if url.get_backend_name() == "sqlite":
        _create_file(Path(str(url.database)), display_url(url))
    database = connect(storage)
    if not _revision(database):
        _guarded(database, lambda: create_schema(database.engine, database.url))
    return _current(database)


def upgrade_database(storage: str, announce: Callable[[str], None] = lambda _: None) -> Database:
    """Return an existing database after bringing the tables of gtf-tune and of Optuna to this version.

    A SQLite file that will change is copied first; ``announce`` says where to.

    Raises
    ------
    StorageError
        It does not exist, cannot be reached or written to, or its tables are newer than this version.
    """
    database = connect(storage)
    if _revision(database) in ("", *REVISIONS):
        _guarded(database, lambda: _upgrade(database, announce))
    return _current(database)


def _upgrade(database: Database, announce: Callable[[str], None]) -> None:
    found = optuna_revision(database.reader)
    will_change = found.is_older or current_revision(database.reader) != REVISIONS[-1]
    if will_change and found.exist and database.url.get_backend_name() == "sqlite":
        announce(f"copied {database.shown_url} to {back_up(Path(str(database.url.database)))} before its upgrade")
    upgrade_schema(database.engine, database.url)


def connect(storage: str) -> Database:
    """Return an existing database whatever tables it has.

    Raises
    ------
    StorageError
        It does not exist, is no database or cannot be reached.
    """
    url = parse_url(storage)
    if url.get_backend_name() == "sqlite":
        _check_file(Path(str(url.database)), display_url(url))
    engine = make_engine(url)
    database = Database(url, engine, engine.execution_options(**_reading(engine)), _file_of(url))
    _guarded(database, lambda: engine.connect().close())
    return database


def _file_of(url: URL) -> "_File | None":
    """Return the SQLite file that this process writes to; ``None`` for servers and for what it can only read."""
    path = Path(str(url.database)).absolute()
    return _File.at(path) if url.get_backend_name() == "sqlite" and can_write(path) else None


@dataclass(frozen=True)
class _File:
    """What tells a file from another one of its name; ``inode`` is 0 where there is none."""

    path: Path
    device: int = 0
    inode: int = 0

    @classmethod
    def at(cls, path: Path) -> Self:
        """Return the file that lies there now."""
        try:
            status = path.stat()
        except OSError:
            return cls(path)
        return cls(path, status.st_dev, status.st_ino)


def _reading(engine: Engine) -> dict[str, Any]:
    if engine.dialect.name == "sqlite":
        return {READ_ONLY: True}
    return {"isolation_level": "REPEATABLE READ", "postgresql_readonly": True}


def _current(database: Database) -> Database:
    try:
        check_revision(_revision(database), database.shown_url)
    except StorageError:
        database.close()
        raise
    return database


def _revision(database: Database) -> str:
    return _guarded(database, lambda: current_revision(database.reader))


def _guarded(database: Database, work: Callable[[], Result]) -> Result:
    """Do what is not a unit of work of a session, with the same errors."""
    try:
        return work()
    except StorageError:
        database.close()
        raise
    except SQLAlchemyError as error:
        database.close()
        raise storage_error(error, database.url) from error


def _check_file(path: Path, shown: str) -> None:
    if _holds(path, Path.is_dir):
        raise StorageError(
            f"the storage must be a file, but {path} is a folder; give a file such as {path}/gtf-tune.db"
        )
    if not _holds(path, Path.exists):
        raise StorageError(f"there is no storage at {path}; create a study in it first", remedy=("create", shown))


def _create_file(path: Path, shown: str) -> None:
    if not _holds(path.parent, Path.is_dir):
        raise StorageError(
            f"the folder {path.parent} of the storage does not exist; make it with mkdir -p {path.parent}"
        )
    try:
        path.open("ab").close()
    except IsADirectoryError:
        _check_file(path, shown)
    except OSError as error:
        raise StorageError(
            f"{path} cannot be written to ({error.strerror}); choose a storage in another folder", remedy=("storage",)
        ) from error


def _holds(path: Path, condition: Callable[[Path], bool]) -> bool:
    try:
        return condition(path)
    except OSError as error:  # of a folder above it, which may not be entered
        raise StorageError(
            f"{path} cannot be reached ({error.strerror}); choose a storage in another folder", remedy=("storage",)
        ) from error
