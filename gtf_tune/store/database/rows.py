"""Turn rows into the frozen values that leave the store."""

from collections.abc import Iterable, Iterator
from dataclasses import fields
from typing import Any, TypeVar, cast

from sqlalchemy import Table

Value = TypeVar("Value")
Item = TypeVar("Item")

_CHUNK = 500


def columns_of(model: type, value_type: type) -> list[Any]:
    """Return the columns of a table that fill a value, in the order of its fields."""
    return [getattr(model, one.name) for one in fields(value_type)]


def table_of(model: type) -> Table:
    """Return the table of a model, for rows that need no bookkeeping as objects."""
    return cast("Table", model.__table__)  # type: ignore[attr-defined]


def chunks(items: Iterable[Item], size: int = _CHUNK) -> Iterator[list[Item]]:
    """Yield the items in lists short enough for the parameters of one statement."""
    todo = list(items)
    for start in range(0, len(todo), size):
        yield todo[start : start + size]
