"""Compare the tables of Optuna in a database with those that the installed Optuna works on."""

from dataclasses import dataclass
from functools import cache
from pathlib import Path

from sqlalchemy import Engine, column, inspect, select, table

from gtf_tune.errors import StorageError
from gtf_tune.store.database.engine import READ_ONLY

_REVISIONS = table("alembic_version", column("version_num"))
_VERSIONS = table("version_info", column("schema_version"))


@dataclass(frozen=True)
class OptunaRevision:
    """Version of the tables of Optuna in a database.

    Attributes
    ----------
    exist
        Whether there are any.
    revisions
        Alembic's revisions; one, unless something is wrong.
    schema_version
        Optuna's own older count of revisions; 0 where none is stored.
    """

    exist: bool
    revisions: tuple[str, ...]
    schema_version: int

    @property
    def is_newer(self) -> bool:
        """Whether a newer Optuna than the installed one made them."""
        from optuna.storages._rdb.models import SCHEMA_VERSION

        newer = self.schema_version > SCHEMA_VERSION or not set(self.revisions) <= set(_known_revisions())
        return self.exist and newer

    @property
    def is_older(self) -> bool:
        """Whether they have to be upgraded before the installed Optuna can work on them."""
        from optuna.storages._rdb.models import SCHEMA_VERSION

        if self.is_newer or not self.exist:
            return False
        # Optuna counts by Alembic since 0.10; it takes tables without a revision for its own if the other count agrees.
        return self.revisions != _known_revisions()[:1] if self.revisions else self.schema_version != SCHEMA_VERSION

    def fault(self, shown_url: str) -> StorageError | None:
        """Return the error of these tables, with what to do about it, or None if the installed Optuna works on them."""
        import optuna

        if self.revisions and not self.exist:
            return StorageError(
                f"{shown_url} holds the table {_REVISIONS.name} of another program, which Optuna needs for itself; "
                "choose a database of its own",
                remedy=("storage",),
            )
        revision = ", ".join(self.revisions) or "none"
        if self.is_newer:
            return StorageError(
                f"the Optuna tables in {shown_url} were made by a newer Optuna (revision {revision}, this is Optuna "
                f"{optuna.__version__}); install the newer Optuna"
            )
        if self.is_older:
            return StorageError(
                f"the Optuna tables in {shown_url} were made by an older Optuna (revision {revision}, this is Optuna "
                f"{optuna.__version__}); programs that still use that one cannot read them after an upgrade, so make a "
                "backup, then upgrade the storage, or choose another one",
                remedy=("upgrade", shown_url),
            )
        return None


def optuna_revision(engine: Engine) -> OptunaRevision:
    """Return the version of the tables of Optuna in a database; nothing is written."""
    with engine.execution_options(**{READ_ONLY: True}).connect() as connection:
        names = inspect(connection).get_table_names()
        revisions = connection.scalars(select(_REVISIONS.c.version_num)).all() if _REVISIONS.name in names else ()
        versions = connection.scalars(select(_VERSIONS.c.schema_version)).all() if _VERSIONS.name in names else ()
    return OptunaRevision("studies" in names, tuple(revisions), max(versions, default=0))


@cache
def _known_revisions() -> tuple[str, ...]:
    """Return the revisions that the installed Optuna knows, newest first; it reads all of its migrations."""
    from alembic.script import ScriptDirectory
    from optuna.storages import _rdb

    scripts = ScriptDirectory(Path(_rdb.__path__[0]) / "alembic")
    return tuple(script.revision for script in scripts.walk_revisions())
