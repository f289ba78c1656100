"""Run the migrations on the connection that the caller hands over, and look at our own tables only."""

from alembic import context

from gtf_tune.store.database.models import TABLE_PREFIX, Base
from gtf_tune.store.database.schema import VERSION_TABLE


def include_name(name: str | None, kind: str, parents: object) -> bool:
    """Return True if a table is ours; Optuna's tables live in the same database."""
    return kind != "table" or (name or "").startswith(TABLE_PREFIX)


def run_migrations() -> None:
    """Migrate in one transaction, on SQLite too."""
    context.configure(
        connection=context.config.attributes["connection"],
        target_metadata=Base.metadata,
        version_table=VERSION_TABLE,
        include_name=include_name,
        render_as_batch=True,
        transactional_ddl=True,
    )
    with context.begin_transaction():
        context.run_migrations()


run_migrations()
