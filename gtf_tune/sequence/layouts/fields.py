"""Read values out of JSON and YAML files; every fault names the file and the key."""

import json
import math
from collections.abc import Collection, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import yaml
from numpy.typing import NDArray

from gtf_tune.errors import SequenceError
from gtf_tune.sequence.layouts.tables import parse_number, read_text, shortened

_LARGEST_COUNT = 1_000_000_000


@dataclass(frozen=True, eq=False)
class Field:
    """Value in a file, and the ``key`` under which it stands there, such as ``frames[3].transform_matrix``.

    Where ``value`` is a mapping, keys that it lacks are looked for in ``defaults``.
    Every method that returns a plain value raises `SequenceError` where the value is something else.
    """

    value: object
    path: Path
    key: str = ""
    defaults: "Field | None" = None

    def __contains__(self, name: str) -> bool:
        return name in self._mapping() or (self.defaults is not None and name in self.defaults)

    def __getitem__(self, name: str) -> "Field":
        """Return the value under a key, or its default; a key that is not there is a fault."""
        found = self._mapping()
        if name not in found and self.defaults is not None:
            return self.defaults[name]
        if name not in found:
            inside = f"{self.key}: " if self.key else ""
            raise SequenceError(f"{self.path}: {inside}expected a key '{name}', found none; check the file")
        return Field(found[name], self.path, f"{self.key}.{name}" if self.key else name)

    def first(self, *names: str) -> "Field | None":
        """Return the value under the first of these keys that is there, or ``None``."""
        return next((self[name] for name in names if name in self), None)

    def names(self) -> tuple[str, ...]:
        """Return the keys of a mapping."""
        return tuple(str(name) for name in self._mapping())

    def items(self) -> Iterator["Field"]:
        """Yield the values of a list."""
        if not isinstance(self.value, list):
            raise self.fault("a list")
        for number, value in enumerate(self.value):
            yield Field(value, self.path, f"{self.key}[{number}]")

    def number(self) -> float:
        """Return a finite number."""
        number = _number(self.value)
        if number is None or not math.isfinite(number):
            raise self.fault("a finite number")
        return number

    def count(self) -> int:
        """Return a whole number of at least 1, as sizes are."""
        number = _number(self.value)
        if number is None or not 1 <= number <= _LARGEST_COUNT or number != int(number):
            raise self.fault("a whole number of at least 1")
        return int(number)

    def text(self) -> str:
        """Return a text that is not empty."""
        if not isinstance(self.value, str) or not self.value or "\0" in self.value:
            raise self.fault("a text")
        return self.value

    def flag(self) -> bool:
        """Return a truth value, which may also be 0, 1 or a word."""
        if isinstance(self.value, bool):
            return self.value
        words = {"true": True, "yes": True, "1": True, "1.0": True, "false": False, "no": False, "0": False}
        known = words.get(str(self.value).lower()) if isinstance(self.value, str | int | float) else None
        if known is None:
            raise self.fault("true or false")
        return known

    def numbers(self, *counts: int) -> list[float]:
        """Return a list of finite numbers, as many as one of ``counts`` says."""
        if not isinstance(self.value, list) or len(self.value) not in counts:
            raise self.fault(f"a list of {' or '.join(map(str, counts))} numbers")
        return [item.number() for item in self.items()]

    def counts(self, count: int) -> list[int]:
        """Return a list of so many whole numbers of at least 1."""
        if not isinstance(self.value, list) or len(self.value) != count:
            raise self.fault(f"a list of {count} whole numbers")
        return [item.count() for item in self.items()]

    def matrix(self, rows: int, columns: int) -> NDArray[np.float64]:
        """Return a matrix of numbers, nested or in one row; NaN and infinity are let through."""
        found = [_number(value) for value in _flat(self.value)]
        nested = isinstance(self.value, list) and all(isinstance(row, list) for row in self.value)
        shaped = not nested or _has_shape(self.value, rows, columns)
        numbers = [number for number in found if number is not None]
        if not shaped or len(found) != rows * columns or len(numbers) != len(found):
            raise self.fault(f"a {rows}x{columns} matrix of numbers")
        return np.array(numbers, dtype=np.float64).reshape(rows, columns)

    def others(self, known: Collection[str]) -> list[str]:
        """Return the keys of a mapping that are not among the known ones."""
        return [name for name in self.names() if name not in known]

    def _mapping(self) -> dict[Any, Any]:
        if not isinstance(self.value, dict):
            raise self.fault("a mapping of keys to values")
        return self.value

    def fault(self, expected: str) -> SequenceError:
        """Return the error that this value is not what was expected."""
        where = f"{self.key} should be" if self.key else "expected"
        return SequenceError(f"{self.path}: {where} {expected}, not {_shown(self.value)}; check the file")


def read_json(path: Path) -> Field:
    """Return the contents of a JSON file.

    Raises
    ------
    SequenceError
        The file cannot be read or is not JSON.
    """
    try:
        return Field(json.loads(read_text(path)), path)
    except (ValueError, RecursionError) as error:
        raise SequenceError(f"{path}: expected JSON ({_reason(error)}); check the file") from error


def read_yaml(path: Path) -> Field:
    """Return the contents of a YAML file, also of one that OpenCV wrote; every plain value is a text.

    Raises
    ------
    SequenceError
        The file cannot be read or is not YAML.
    """
    # OpenCV's first line, %YAML:1.0, is none that YAML knows.
    lines = ["" if line.startswith("%YAML") else line for line in read_text(path).splitlines()]
    try:
        return Field(yaml.load("\n".join(lines), Loader=yaml.BaseLoader), path)  # makes texts only
    except (yaml.YAMLError, ValueError, RecursionError) as error:
        raise SequenceError(f"{path}: expected YAML ({_reason(error)}); check the file") from error


def _reason(error: Exception) -> str:
    """Return the fault of a file in one line."""
    if isinstance(error, RecursionError):
        return "values are nested too deeply"
    return shortened(" ".join(str(getattr(error, "problem", None) or error).split()))


def _number(value: object) -> float | None:
    if isinstance(value, str):
        return parse_number(value)
    if isinstance(value, bool) or not isinstance(value, int | float):
        return None
    try:
        return float(value)
    except OverflowError:
        return math.inf


def _flat(value: object) -> Iterator[object]:
    """Yield the values of a list, or of the lists in it."""
    for row in value if isinstance(value, list) else [value]:
        yield from row if isinstance(row, list) else [row]


def _has_shape(value: object, rows: int, columns: int) -> bool:
    return isinstance(value, list) and len(value) == rows and all(len(row) == columns for row in value)


def _shown(value: object) -> str:
    if isinstance(value, dict):
        return "a mapping"
    if isinstance(value, list):
        return f"a list of {len(value)}"
    if value is None:
        return "null"
    if isinstance(value, int) and abs(value) > _LARGEST_COUNT:
        return "a very large number"
    return shortened(json.dumps(value)) if isinstance(value, bool | int | float) else f"'{shortened(str(value))}'"
