"""Edit single values of JSON files where they stand in the text."""

import json
import re
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

from gtf_tune.errors import DefinitionError
from gtf_tune.input_files import parse_json

_SPACE = re.compile(r"[ \t\r\n]*")
_DECODER = json.JSONDecoder()


@dataclass(frozen=True)
class _Value:
    key: str
    start: int
    end: int
    value: Any


def keys(text: str) -> tuple[str, ...]:
    """Return the dotted paths of all values, those of objects included; items of arrays have none."""
    return tuple(value.key for value in _values(text))


def values(text: str) -> dict[str, bool | int | float | str]:
    """Return every single value by its dotted path."""
    return {span.key: span.value for span in _values(text) if isinstance(span.value, bool | int | float | str)}


def replace(text: str, key: str, value: bool | int | float | str) -> str:
    """Return the text with another value at a key that is there once and holds a single value."""
    found = [span for span in _values(text) if span.key == key]
    if len(found) != 1:
        raise DefinitionError(f"the settings file has the key '{key}' {len(found)} times; it must have it once")
    if isinstance(found[0].value, dict | list):
        raise DefinitionError(f"the key '{key}' of the settings file does not hold a single value; give a longer path")
    return text[: found[0].start] + json.dumps(value, ensure_ascii=False) + text[found[0].end :]


def add(text: str, key: str, value: bool | int | float | str) -> str:
    """Return the text with a new key as the first of the deepest object of its path that is there."""
    parents = [span for span in _values(text) if key.startswith(span.key + ".")]
    whole = _Value("", _SPACE.match(text).end(), len(text), _whole(text))  # type: ignore[union-attr]
    parent = max(parents, key=lambda span: len(span.key), default=whole)
    if not isinstance(parent.value, dict):
        raise DefinitionError(
            f"the key '{key}' cannot be added to the settings file, where '{parent.key}' is no object; write it there "
            "by hand"
        )
    *outer, last = key.removeprefix(f"{parent.key}." if parent.key else "").split(".")
    content: Any = {last: value}
    for name in reversed(outer):
        content = {name: content}
    comma = ", " if parent.value else ""
    return text[: parent.start + 1] + json.dumps(content, ensure_ascii=False)[1:-1] + comma + text[parent.start + 1 :]


def _values(text: str) -> Iterator[_Value]:
    _whole(text)
    yield from _members(text, _skip(text, 0), "")


def _whole(text: str) -> dict[str, Any]:
    try:
        content = parse_json(text)
    except ValueError as error:
        raise DefinitionError(f"the settings file is not valid JSON: {error}") from error
    if not isinstance(content, dict):
        raise DefinitionError("the settings file must hold a JSON object")
    return content


def _members(text: str, start: int, prefix: str) -> Iterator[_Value]:
    """Yield the values of the object that starts at an index of valid JSON."""
    position = _skip(text, start + 1)
    while text[position] != "}":
        name, position = _DECODER.raw_decode(text, position)
        position = _skip(text, _skip(text, position) + 1)
        value, end = _DECODER.raw_decode(text, position)
        yield _Value(prefix + name, position, end, value)
        if isinstance(value, dict):
            yield from _members(text, position, f"{prefix}{name}.")
        position = _skip(text, end)
        position = _skip(text, position + 1) if text[position] == "," else position


def _skip(text: str, position: int) -> int:
    match = _SPACE.match(text, position)
    return match.end() if match else position
