"""Read the plain tables of numbers that data sets are described in."""

import math
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from gtf_tune.errors import SequenceError


def read_text(path: Path) -> str:
    """Return the text of a file, or raise `SequenceError` that names it."""
    try:
        return path.read_text(encoding="utf-8-sig")
    except OSError as error:
        raise SequenceError(f"{path}: cannot read the file ({error.strerror}); check the path") from error
    except UnicodeDecodeError as error:
        raise SequenceError(f"{path}: expected a text file, found other bytes; check the download") from error


def read_rows(path: Path, separator: str | None = None) -> list[tuple[int, list[str]]]:
    """Return (line number from 1, fields) of each line that is neither empty nor a comment that starts with ``#``."""
    rows = []
    for number, line in enumerate(read_text(path).splitlines(), start=1):
        content = line.strip()
        if content and not content.startswith("#"):
            rows.append((number, [field.strip() for field in content.split(separator)]))
    return rows


def to_numbers(fields: list[str], path: Path, line: int) -> list[float]:
    """Return the fields as finite numbers, or raise `SequenceError` that names file and line."""
    numbers = _to_floats(fields, path, line)
    if not all(math.isfinite(number) for number in numbers):
        raise SequenceError(f"{path}:{line}: expected finite numbers, found '{' '.join(fields)}'; mend the line")
    return numbers


def read_numbers(path: Path) -> NDArray[np.float64]:
    """Return all numbers of a file in one row, whatever its line breaks; they must be finite."""
    numbers = [value for line, fields in read_rows(path) for value in to_numbers(fields, path, line)]
    return np.array(numbers, dtype=np.float64)


def read_matrix(path: Path, rows: int, columns: int) -> NDArray[np.float64]:
    """Return the leading ``rows`` x ``columns`` numbers of a file with one matrix; infinity and NaN are let through."""
    numbers = [value for line, fields in read_rows(path) for value in _to_floats(fields, path, line)]
    if len(numbers) < rows * columns:
        raise SequenceError(f"{path}: expected a {rows}x{columns} matrix, found {len(numbers)} numbers; check the file")
    return np.array(numbers[: rows * columns], dtype=np.float64).reshape(rows, columns)


def _to_floats(fields: list[str], path: Path, line: int) -> list[float]:
    try:
        return [float(field) for field in fields]
    except ValueError as error:
        raise SequenceError(f"{path}:{line}: expected numbers, found '{' '.join(fields)}'; mend the line") from error
