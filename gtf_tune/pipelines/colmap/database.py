"""Copy COLMAP databases, whole or in part."""

import contextlib
import sqlite3
from collections.abc import Collection, Iterator
from pathlib import Path


def copy_database(source: Path, target: Path, *, without: Collection[str] = ()) -> None:
    """Copy a closed COLMAP database to a new file, leaving out the rows of some tables.

    The copy is one plain file that opens read-only, not in SQLite's write-ahead mode in which COLMAP leaves its own.
    """
    with _attached(source, target) as connection:
        (version,) = connection.execute("PRAGMA source.user_version").fetchone()
        connection.execute(f"PRAGMA user_version = {version}")
        schema = "SELECT type, name, sql FROM source.sqlite_master WHERE sql NOT NULL AND name NOT LIKE 'sqlite_%'"
        items = connection.execute(schema).fetchall()
        for _, _, statement in items:
            connection.execute(statement)
        for kind, name, _ in items:
            if kind == "table" and name not in without:
                connection.execute(f"INSERT INTO main.{name} SELECT * FROM source.{name}")


def add_rows(source: Path, target: Path, table: str) -> None:
    """Append the rows of one table of a closed COLMAP database to the same table of another."""
    with _attached(source, target) as connection:
        connection.execute(f"INSERT INTO main.{table} SELECT * FROM source.{table}")


def copy_rows(source: Path, target: Path, table: str) -> None:
    """Copy a closed COLMAP database with the rows of one table only."""
    copy_database(source, target, without=_tables(source) - {table})


def _tables(path: Path) -> set[str]:
    with contextlib.closing(sqlite3.connect(_frozen(path), uri=True)) as connection:
        return {name for (name,) in connection.execute("SELECT name FROM sqlite_master WHERE type = 'table'")}


@contextlib.contextmanager
def _attached(source: Path, target: Path) -> Iterator[sqlite3.Connection]:
    with contextlib.closing(sqlite3.connect(target.absolute().as_uri(), uri=True, isolation_level=None)) as connection:
        # What is copied here can be computed again, so waiting for the disk buys nothing.
        connection.execute("PRAGMA synchronous = OFF")
        connection.execute("ATTACH DATABASE ? AS source", (_frozen(source),))
        connection.execute("BEGIN")
        yield connection
        connection.execute("COMMIT")


def _frozen(path: Path) -> str:
    """Return the address of a database that nobody writes to, so that SQLite creates no files beside it."""
    return f"{path.absolute().as_uri()}?immutable=1"


def make_plain(path: Path) -> None:
    """Turn a database that COLMAP has closed into one plain file that opens read-only."""
    with contextlib.closing(sqlite3.connect(path)) as connection:
        connection.execute("PRAGMA journal_mode = DELETE")
