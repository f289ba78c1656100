"""Make SQLAlchemy engines that stand many processes on one database."""

import os
import sqlite3
from contextlib import closing
from pathlib import Path
from typing import Any

from sqlalchemy import Connection, Engine, NullPool, create_engine, event
from sqlalchemy.dialects import plugins
from sqlalchemy.engine import URL, CreateEnginePlugin, make_url
from sqlalchemy.exc import ArgumentError

from gtf_tune.errors import StorageError
from gtf_tune.input_files import read_input_text

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


READ_ONLY = "gtf_tune_read_only"
_LOCK_TIMEOUT_S = 60
_PLUGIN = "gtf_tune"


class Tuning(CreateEnginePlugin):
    """Attach the settings of connections and transactions to an engine while SQLAlchemy builds it.

    A plugin is named in the arguments of ``create_engine``: that is how it reaches the engine that Optuna builds for
    itself before its first transaction.
    """

    def update_url(self, url: URL) -> URL:
        """Return the URL as it is."""
        return url

    def engine_created(self, engine: Engine) -> None:
        """Attach the listeners that suit the database."""
        on_sqlite = engine.dialect.name == "sqlite"
        if on_sqlite:
            event.listen(engine, "begin", _begin_sqlite)
        tune = _tune_sqlite if on_sqlite else _tune_postgresql
        if not event.contains(engine.pool, "connect", tune):
            event.listen(engine.pool, "connect", tune)


def _tune_sqlite(connection: Any, _: object) -> None:
    # Else the driver opens transactions by itself, and too late: at the first write (see `_begin_sqlite`).
    connection.isolation_level = None
    settings = ["journal_mode = WAL", "synchronous = NORMAL", "foreign_keys = ON"]
    cursor = connection.cursor()
    for setting in settings[1:] if isinstance(connection, ReadOnlyConnection) else settings:
        cursor.execute(f"PRAGMA {setting}")
    cursor.close()


def _begin_sqlite(connection: Connection) -> None:
    """Take the write lock at the start: taken after a first SELECT it can fail, or two writers see one state."""
    read_only = isinstance(connection.connection.dbapi_connection, ReadOnlyConnection)
    reading = read_only or connection.get_execution_options().get(READ_ONLY, False)
    connection.exec_driver_sql("BEGIN" if reading else "BEGIN IMMEDIATE")


def _tune_postgresql(connection: Any, _: object) -> None:
    """Make the server drop a client that vanished inside a transaction, with the locks that it holds."""
    with connection.cursor() as cursor:
        cursor.execute(f"SET idle_in_transaction_session_timeout = '{_LOCK_TIMEOUT_S}s'")
    connection.commit()


def shared_arguments(engine: Engine) -> dict[str, Any]:
    """Return the arguments of ``create_engine`` for a second engine on the connections of the first."""
    plugins.register(_PLUGIN, __name__, Tuning.__name__)
    return {"pool": engine.pool, "plugins": [_PLUGIN], "hide_parameters": True}


def untuned_arguments(url: URL) -> dict[str, Any]:
    """Return the arguments of ``create_engine`` for connections of their own, without the tuning of transactions."""
    if url.get_backend_name() == "sqlite":
        return {"connect_args": {"timeout": _LOCK_TIMEOUT_S}, "hide_parameters": True}
    alive = {"keepalives_idle": 30, "keepalives_interval": 10, "keepalives_count": 3, "tcp_user_timeout": 60_000}
    defaults = {"connect_timeout": 10, "application_name": "gtf-tune", **alive}
    connect = {key: value for key, value in defaults.items() if key not in url.query}
    # PgBouncer that pools transactions gives a prepared statement's name to whoever comes next.
    return {"connect_args": {**connect, "prepare_threshold": None}, "pool_pre_ping": True, "hide_parameters": True}


def make_engine(url: URL) -> Engine:
    """Return a tuned engine; connects to nothing yet.

    That of a SQLite file that cannot be written to opens it anew for each transaction: only so are later changes seen.

    Raises
    ------
    StorageError
        The driver of PostgreSQL is not installed.
    """
    plugins.register(_PLUGIN, __name__, Tuning.__name__)
    try:
        return create_engine(url, plugins=[_PLUGIN], **untuned_arguments(url), **_read_only_arguments(url))
    except ModuleNotFoundError as error:
        raise StorageError(
            f"storage on PostgreSQL needs the driver '{error.name}'; run pip install 'gtf-tune[postgres]'"
        ) from error


def _read_only_arguments(url: URL) -> dict[str, Any]:
    path = Path(str(url.database))
    if url.get_backend_name() != "sqlite" or can_write(path):
        return {}
    return {"creator": lambda: connect_read_only(path, _LOCK_TIMEOUT_S), "poolclass": NullPool}


_POSTGRESQL_PORT = 5432
_SECRET_QUERY_KEYS = frozenset({"password", "sslpassword"})


def parse_url(storage: str) -> URL:
    """Return the URL of a storage given as a file path, ``sqlite:///FILE`` or ``postgresql://USER@HOST/NAME``.

    ``@FILE`` stands for the text in a file: a password then is neither on a command line nor in the environment.

    Raises
    ------
    StorageError
        The text is no URL, names another kind of database, or is a SQLite URL without a file.
    """
    if storage.startswith("@"):
        storage = _content_of(Path(storage[1:]).expanduser())
    if not storage.strip():
        raise StorageError("the storage is empty; give a file such as gtf-tune.db or a postgresql+psycopg:// URL")
    if "://" not in storage:
        return URL.create("sqlite", database=str(Path(storage).expanduser()))
    try:
        url = make_url(storage)
    except (ArgumentError, ValueError) as error:
        raise StorageError(
            "the storage URL cannot be read; write sqlite:///FILE or postgresql+psycopg://USER@HOST:PORT/NAME, "
            "with special characters of the password percent-encoded"
        ) from error
    return _checked(url)


def _content_of(path: Path) -> str:
    try:
        return read_input_text(path).strip()
    except (OSError, UnicodeDecodeError) as error:
        reason = error.strerror if isinstance(error, OSError) else "it is no text"
        raise StorageError(f"{path}, which should hold the URL of the storage, cannot be read ({reason})") from error


def _checked(url: URL) -> URL:
    backend = url.get_backend_name()
    if backend == "postgresql":
        return url.set(drivername="postgresql+psycopg")
    if backend != "sqlite":
        raise StorageError(f"the storage must be SQLite or PostgreSQL, not '{backend}'; see storage/README.md")
    if not url.database or url.database == ":memory:" or url.database.startswith("file:"):
        raise StorageError("a SQLite storage must be a file on disk; write sqlite:///FILE")
    return url.set(drivername="sqlite")


def display_url(url: URL | str) -> str:
    """Return a storage URL for messages and logs, every password in it replaced by stars."""
    parsed = parse_url(url) if isinstance(url, str) else url
    secrets = {key: "***" for key in parsed.query if key in _SECRET_QUERY_KEYS}
    return parsed.update_query_dict(secrets).render_as_string(hide_password=True)


def place_of(url: URL) -> tuple[str, ...]:
    """Return what is equal for two URLs that are certain to name the same database, whoever asks for it."""
    if url.get_backend_name() == "sqlite":
        return (str(Path(str(url.database)).resolve()),)
    return (url.host or "", str(url.port or _POSTGRESQL_PORT), url.database or "", str(url.query.get("host", "")))


def without_passwords(text: str, url: URL) -> str:
    """Return a driver's message with every password of the URL replaced by stars."""
    queried = (value for key, value in url.query.items() if key in _SECRET_QUERY_KEYS)
    for secret in (url.password, *queried):
        if isinstance(secret, str) and secret:
            text = text.replace(secret, "***")
    return text
