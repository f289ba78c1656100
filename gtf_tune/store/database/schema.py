"""Make and upgrade the tables of gtf-tune and of Optuna, safely when many processes do so at once.

Both keep the revision of their tables in a table of their own: ``gtf_alembic_version`` and ``alembic_version``.
"""

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from sqlalchemy import Connection, Engine, column, inspect, select, table, text
from sqlalchemy.engine import URL

from gtf_tune.errors import StorageError
from gtf_tune.operating_system import lock, opened_folder
from gtf_tune.store.database.engine import READ_ONLY, display_url, untuned_arguments
from gtf_tune.store.optuna.revision import optuna_revision

VERSION_TABLE = "gtf_alembic_version"
REVISIONS = ("0001",)
_ADVISORY_LOCK = 0x6774_6674_756E_6531


def current_revision(engine: Engine) -> str:
    """Return the revision of our tables, or an empty text where the database has none of them."""
    with engine.execution_options(**{READ_ONLY: True}).connect() as connection:
        if not inspect(connection).has_table(VERSION_TABLE):
            return ""
        # Alembic would say the same, and take longer to import than a listing to print.
        return connection.scalar(select(column("version_num")).select_from(table(VERSION_TABLE))) or ""


def check_revision(revision: str, shown_url: str) -> None:
    """Raise `StorageError` unless tables of this revision fit this version."""
    if revision == REVISIONS[-1]:
        return
    upgrade = ("upgrade", shown_url)
    if not revision:
        raise StorageError(
            f"{shown_url} has no tables of gtf-tune yet; create a study in it, or upgrade the storage", remedy=upgrade
        )
    if revision in REVISIONS:
        raise StorageError(
            f"{shown_url} was made by an older gtf-tune (revision {revision}, not {REVISIONS[-1]}); upgrade it",
            remedy=upgrade,
        )
    raise StorageError(
        f"{shown_url} was made by a newer gtf-tune (revision {revision}, this one knows {REVISIONS[-1]}); install the "
        "newer gtf-tune"
    )


def create_schema(engine: Engine, url: URL) -> None:
    """Make all tables, unless another process has done so meanwhile.

    Raises
    ------
    StorageError
        There are tables of an older or newer Optuna, which other programs may use.
    """
    with _alone(engine, url):
        if not current_revision(engine):
            _refuse(optuna_revision(engine).fault(display_url(url)))
            _update_optuna(url)
            _update_ours(engine)


def upgrade_schema(engine: Engine, url: URL) -> None:
    """Bring the tables of an old database, and those that it lacks, to this version.

    Raises
    ------
    StorageError
        There are tables of a newer Optuna.
    """
    with _alone(engine, url):
        found = optuna_revision(engine)
        if not found.is_older:
            _refuse(found.fault(display_url(url)))
        _update_optuna(url)
        _update_ours(engine)


def _refuse(fault: StorageError | None) -> None:
    if fault is not None:
        raise fault


def _update_ours(engine: Engine) -> None:
    from alembic import command
    from alembic.config import Config

    config = Config()
    config.set_main_option("script_location", "gtf_tune.store:migrations")
    config.set_main_option("path_separator", "os")
    with engine.begin() as connection:
        config.attributes["connection"] = connection
        command.upgrade(config, "head")


def _update_optuna(url: URL) -> None:
    from optuna.exceptions import StorageInternalError
    from optuna.storages import RDBStorage

    try:
        # Optuna opens a second connection inside a transaction, which our write lock at BEGIN would block for ever.
        storage = RDBStorage(optuna_url(url), engine_kwargs=untuned_arguments(url), skip_compatibility_check=True)
        if storage.get_current_version() != storage.get_head_version():
            storage.upgrade()
    except StorageInternalError as error:
        raise error.__cause__ or error from error
    storage.remove_session()
    storage.engine.dispose()


def optuna_url(url: URL) -> str:
    """Return the URL as Optuna takes it: a text in which braces are doubled, since Optuna formats it."""
    return url.render_as_string(hide_password=False).replace("{", "{{").replace("}", "}}")


@contextmanager
def _alone(engine: Engine, url: URL) -> Iterator[None]:
    """Keep other processes out: by a lock on the folder of a SQLite file, by an advisory lock on PostgreSQL."""
    if engine.dialect.name == "sqlite":
        with opened_folder(Path(str(url.database)).resolve().parent) as folder:
            lock(folder)
            yield
        return
    with advisory_transaction(engine) as connection:
        connection.execute(text("SELECT pg_advisory_xact_lock(:key)"), {"key": _ADVISORY_LOCK})
        yield


@contextmanager
def advisory_transaction(engine: Engine) -> Iterator[Connection]:
    """Yield a connection in a transaction for an advisory lock, which lasts as long as the context does.

    A lock of the session would be that of whoever gets the connection next where PgBouncer pools transactions.
    """
    with engine.connect() as connection, connection.begin():
        connection.execute(text("SET LOCAL idle_in_transaction_session_timeout = 0"))
        yield connection
