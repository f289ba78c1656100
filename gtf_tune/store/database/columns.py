"""Column types and the clock, the same on SQLite and on PostgreSQL."""

import json
import math
from typing import Any

from sqlalchemy import Dialect, Double, String, Text
from sqlalchemy.ext.compiler import compiles
from sqlalchemy.sql.compiler import SQLCompiler
from sqlalchemy.sql.functions import FunctionElement
from sqlalchemy.types import TypeDecorator

from gtf_tune.errors import StorageError


class Words(TypeDecorator[str]):
    """Keep any text, such as the log of a program, as UTF-8 without NUL characters, which PostgreSQL refuses."""

    impl = Text
    cache_ok = True

    def process_bind_param(self, value: str | None, dialect: Dialect) -> str | None:
        """Replace what cannot be stored by question marks."""
        return None if value is None else value.replace("\0", "?").encode("utf-8", "replace").decode("utf-8")


class Json(TypeDecorator[Any]):
    """Keep a JSON value as canonical text; floats come back bit by bit, NaN included."""

    impl = Text
    cache_ok = True

    def process_bind_param(self, value: Any, dialect: Dialect) -> str | None:
        """Write the value, keys sorted."""
        return None if value is None else json.dumps(value, sort_keys=True, separators=(",", ":"))

    def process_result_value(self, value: str | None, dialect: Dialect) -> Any:
        """Read the value.

        Raises
        ------
        StorageError
            It is no JSON: the database is damaged.
        """
        try:
            return None if value is None else json.loads(value)
        except ValueError as error:
            raise StorageError("a value in the storage is damaged; check the storage", remedy=("check",)) from error


class Real(TypeDecorator[float]):
    """Keep a 64-bit float; NaN becomes NULL, as SQLite would have it anyway."""

    impl = Double
    cache_ok = True

    def process_bind_param(self, value: float | None, dialect: Dialect) -> float | None:
        """Turn NaN into NULL, and NumPy's floats into Python's."""
        return None if value is None or math.isnan(value) else float(value)


class Seed(TypeDecorator[int]):
    """Keep an unsigned 64-bit number, which the integers of both databases cannot."""

    impl = String(20)
    cache_ok = True

    def process_bind_param(self, value: int | None, dialect: Dialect) -> str | None:
        """Write the number in decimal."""
        return None if value is None else str(int(value))

    def process_result_value(self, value: str | None, dialect: Dialect) -> int | None:
        """Read the number."""
        return None if value is None else int(value)


class DatabaseClock(FunctionElement[float]):
    """Stand for the database's time in an SQL expression, in seconds since 1970 UTC."""

    type = Double()
    inherit_cache = True


@compiles(DatabaseClock, "sqlite")
def _on_sqlite(element: DatabaseClock, compiler: SQLCompiler, **options: Any) -> str:
    return "((julianday('now') - 2440587.5) * 86400.0)"


@compiles(DatabaseClock, "postgresql")
def _on_postgresql(element: DatabaseClock, compiler: SQLCompiler, **options: Any) -> str:
    return "CAST(EXTRACT(EPOCH FROM clock_timestamp()) AS DOUBLE PRECISION)"
