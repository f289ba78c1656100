"""Edit single values of TOML files line by line, and check the result against a parse of the whole file."""

import json
import re
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from typing import Any

from gtf_tune.errors import DefinitionError
from gtf_tune.input_files import parse_toml

_PART = r"""(?:[A-Za-z0-9_-]+|"[^"]*"|'[^']*')"""
_DOTTED = rf"{_PART}(?:\s*\.\s*{_PART})*"
_TABLE = re.compile(rf"\s*\[\s*(?P<path>{_DOTTED})\s*\]")
_ARRAY = re.compile(r"\s*\[\[")
_VALUE = r"""(?P<value>"(?:[^"\\]|\\.)*"|'[^']*'|[^\s#,"'\[\]{}]+(?: [0-9:.]+)?)"""
_PAIR = re.compile(rf"\s*(?P<key>{_DOTTED})\s*=\s*{_VALUE}\s*(?:#.*)?$")


@dataclass(frozen=True)
class _Pair:
    path: tuple[str, ...]
    line: int
    start: int
    end: int

    @property
    def key(self) -> str:
        return ".".join(self.path)


def keys(text: str) -> tuple[str, ...]:
    """Return the dotted paths of all values; entries of arrays have none."""
    return tuple(".".join(path) for path, _ in _leaves(_parsed(text)))


def values(text: str) -> dict[str, bool | int | float | str]:
    """Return every single value by its dotted path."""
    found = {".".join(path): value for path, value in _leaves(_parsed(text))}
    return {key: value for key, value in found.items() if isinstance(value, bool | int | float | str)}


def replace(text: str, key: str, value: bool | int | float | str) -> str:
    """Return the text with another value at a key that stands on a line of its own."""
    for pair in _pairs(text):
        if pair.key == key:
            lines = text.splitlines(keepends=True)
            line = lines[pair.line]
            lines[pair.line] = line[: pair.start] + _formatted(value) + line[pair.end :]
            edited = "".join(lines)
            if _differs_only_at(text, edited, pair.path, value):
                return edited
    raise DefinitionError(f"the key '{key}' of the settings file does not hold a single value on a line of its own")


def add(text: str, key: str, value: bool | int | float | str) -> str:
    """Return the text with a new key, in its table if there is one."""
    if text and not text.endswith("\n"):
        text += "\n"
    path = tuple(key.split("."))
    lines = text.splitlines(keepends=True)
    for number, line in enumerate(lines):
        header = _TABLE.match(line)
        if header and not _ARRAY.match(line) and _split(header["path"]) == path[:-1]:
            lines.insert(number + 1, f"{path[-1]} = {_formatted(value)}\n")
            break
    else:
        head = f"[{'.'.join(path[:-1])}]\n" if len(path) > 1 else ""
        lines.insert(len(lines) if head else 0, f"{head}{path[-1]} = {_formatted(value)}\n")
    edited = "".join(lines)
    if not _differs_only_at(text, edited, path, value):
        raise DefinitionError(f"the key '{key}' cannot be added to the settings file; write it there by hand")
    return edited


def _pairs(text: str) -> Iterator[_Pair]:
    table: tuple[str, ...] | None = ()
    for number, line in enumerate(text.splitlines()):
        header, match = _TABLE.match(line), _PAIR.match(line)
        if _ARRAY.match(line):
            table = None
        elif header:
            table = _split(header["path"])
        elif match and table is not None:
            yield _Pair((*table, *_split(match["key"])), number, match.start("value"), match.end("value"))


def _split(dotted: str) -> tuple[str, ...]:
    return tuple(part.strip("\"'") for part in re.findall(_PART, dotted))


def _leaves(table: Mapping[str, Any], path: tuple[str, ...] = ()) -> Iterator[tuple[tuple[str, ...], Any]]:
    for name, value in table.items():
        if isinstance(value, dict):
            yield from _leaves(value, (*path, name))
        else:
            yield (*path, name), value


def _parsed(text: str) -> dict[str, Any]:
    try:
        return parse_toml(text)
    except ValueError as error:
        raise DefinitionError(f"the settings file is not valid TOML: {error}") from error


def _differs_only_at(before: str, after: str, path: tuple[str, ...], value: bool | int | float | str) -> bool:
    expected = _parsed(before)
    table = expected
    for name in path[:-1]:
        table = table.setdefault(name, {})
        if not isinstance(table, dict):
            return False
    table[path[-1]] = value
    try:
        return parse_toml(after) == expected
    except ValueError:
        return False


def _formatted(value: bool | int | float | str) -> str:
    if isinstance(value, bool):
        return str(value).lower()
    # JSON leaves U+007F as it is, TOML wants it escaped.
    return json.dumps(value, ensure_ascii=False).replace("\x7f", "\\u007f") if isinstance(value, str) else repr(value)
