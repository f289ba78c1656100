"""Check that the tables of a database are there and that their texts can be read."""

import json
from collections.abc import Iterator

from sqlalchemy import Column, Text, inspect, select, type_coerce
from sqlalchemy.orm import Session

from gtf_tune.errors import StorageError
from gtf_tune.store.database import Database, models
from gtf_tune.store.database.columns import Json
from gtf_tune.store.database.session import read
from gtf_tune.store.optuna.tables import optuna_tables

_ROWS_AT_ONCE = 500


def check_tables(database: Database) -> None:
    """Return if every table and column is there, ours and Optuna's.

    Raises
    ------
    StorageError
        One is missing, so that nothing else can be checked.
    """
    found = read(database, _columns)
    wanted = [*models.Base.metadata.sorted_tables, *optuna_tables()]
    lost = [table.name for table in wanted if table.name not in found]
    lost += [
        f"{table.name}.{column.name}"
        for table in wanted
        for column in table.columns
        if table.name in found and column.name not in found[table.name]
    ]
    if lost:
        names = ", ".join(lost)
        raise StorageError(f"{database.shown_url} has lost the tables or columns {names}; restore a backup")


def _columns(session: Session) -> dict[str, set[str]]:
    inspector = inspect(session.connection())
    return {name: {column["name"] for column in inspector.get_columns(name)} for name in inspector.get_table_names()}


def unreadable(database: Database) -> list[str]:
    """Return a sentence for every value that should be JSON and is not."""
    definition = models.Base.metadata.tables["gtf_study"].columns["definition"]
    columns = [
        column
        for table in models.Base.metadata.sorted_tables
        for column in table.columns
        if isinstance(column.type, Json) or column is definition
    ]
    return read(database, lambda session: [problem for column in columns for problem in _bad(session, column)])


def _bad(session: Session, column: Column[object]) -> list[str]:
    keys = list(column.table.primary_key.columns)
    query = select(type_coerce(column, Text), *keys).where(column.is_not(None)).order_by(*keys)
    rows = session.connection().execute(query, execution_options={"yield_per": _ROWS_AT_ONCE})
    return list(_sentences(column, ((row[0], row[1:]) for row in rows)))


def _sentences(column: Column[object], rows: Iterator[tuple[str, tuple[object, ...]]]) -> Iterator[str]:
    for text, key in rows:
        try:
            json.loads(text)
        except (ValueError, TypeError):
            row = ", ".join(map(str, key))
            yield f"'{column.name}' of row {row} in {column.table.name} is damaged; restore a backup"
