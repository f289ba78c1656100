"""Read files that users name: regular ones only, and texts of which no depth and no length is a surprise."""

import errno
import json
import tomllib
from collections.abc import Callable
from pathlib import Path
from typing import Any, TypeVar

Value = TypeVar("Value")

_MOST_BYTES = 1 << 28
_DEEPEST = 50
_TOO_DEEP = "values are nested too deeply"
_TOO_LONG = "a number has thousands of digits"


def read_input(path: Path) -> bytes:
    """Return the bytes of a regular file.

    Raises
    ------
    OSError
        It cannot be read; so it is with a pipe or a device, of which reading may never end, and with 256 MB or more.
    """
    if path.exists() and not path.is_file() and not path.is_dir():
        raise OSError(errno.EINVAL, "it is a pipe or a device, not a file", str(path))
    if path.is_file() and path.stat().st_size >= _MOST_BYTES:
        raise OSError(errno.EFBIG, "it is far too large for this", str(path))
    return path.read_bytes()


def read_input_text(path: Path) -> str:
    """Return the text of a regular file in UTF-8.

    Raises
    ------
    OSError, UnicodeDecodeError
        It cannot be read (see `read_input`), or is no text.
    """
    return read_input(path).decode("utf-8")


def parse_toml(text: str) -> dict[str, Any]:
    """Return the contents of a TOML file.

    Raises
    ------
    ValueError
        It is none, nests values too deeply, or has a number of thousands of digits.
    """
    return _parsed(tomllib.loads, text)


def parse_json(text: str) -> Any:
    """Return the contents of a JSON file.

    Raises
    ------
    ValueError
        It is none, nests values too deeply, or has a number of thousands of digits.
    """
    return _parsed(json.loads, text)


def _parsed(loads: Callable[[str], Value], text: str) -> Value:
    try:
        return _shallow(loads(text))
    except RecursionError as error:
        raise ValueError(_TOO_DEEP) from error
    except (tomllib.TOMLDecodeError, json.JSONDecodeError):
        raise
    except ValueError as error:
        raise ValueError(_TOO_LONG) from error


def _shallow(value: Value) -> Value:
    """Return a value in which lists and tables nest at most `_DEEPEST` deep; whoever walks it may use recursion."""
    level: list[Any] = [value]
    for _ in range(_DEEPEST):
        level = [
            inner
            for outer in level
            if isinstance(outer, dict | list)
            for inner in (outer.values() if isinstance(outer, dict) else outer)
        ]
    if level:
        raise ValueError(_TOO_DEEP)
    return value
