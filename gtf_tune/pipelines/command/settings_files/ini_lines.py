"""Edit single values of INI files line by line; COLMAP's, with keys before the first section, are included."""

import re
from collections.abc import Iterator
from dataclasses import dataclass

from gtf_tune.errors import DefinitionError
from gtf_tune.pipelines.command.settings_files.scalars import read_scalar
from gtf_tune.pipelines.options import option_text

_SECTION = re.compile(r"\s*\[(?P<name>[^\]]+)\]")
_PAIR = re.compile(r"\s*(?P<key>[^\s=:#;\[][^=:]*?)\s*[=:][ \t]*(?P<value>.*?)(?P<rest>[ \t]*(?:[ \t][#;].*)?)$")


@dataclass(frozen=True)
class _Pair:
    section: str
    name: str
    line: int
    start: int
    end: int

    @property
    def key(self) -> str:
        return f"{self.section}.{self.name}" if self.section else self.name


def keys(text: str) -> tuple[str, ...]:
    """Return ``section.key`` of every pair; keys before the first section have no prefix."""
    return tuple(pair.key for pair in _pairs(text))


def values(text: str) -> dict[str, bool | int | float | str]:
    """Return every value by ``section.key``."""
    lines = text.splitlines()
    return {pair.key: read_scalar(lines[pair.line][pair.start : pair.end]) for pair in _pairs(text)}


def replace(text: str, key: str, value: bool | int | float | str) -> str:
    """Return the text with another value at a key that is there once."""
    found = [pair for pair in _pairs(text) if pair.key == key]
    if len(found) != 1:
        raise DefinitionError(f"the settings file has the key '{key}' {len(found)} times; it must have it once")
    pair = found[0]
    lines = text.splitlines(keepends=True)
    line = lines[pair.line]
    lines[pair.line] = line[: pair.start] + _formatted(key, value) + line[pair.end :]
    return "".join(lines)


def add(text: str, key: str, value: bool | int | float | str) -> str:
    """Return the text with a new key at the end of its section, which is made if need be."""
    if text and not text.endswith("\n"):
        text += "\n"
    words = _formatted(key, value)
    lines = text.splitlines(keepends=True)
    for section in sorted(_sections(text), key=len, reverse=True):
        if section and key.startswith(f"{section}."):
            lines.insert(_end_of(section, lines), f"{key.removeprefix(f'{section}.')}={words}\n")
            return "".join(lines)
    section, _, name = key.rpartition(".")
    return text + f"[{section}]\n{name}={words}\n" if section else f"{name}={words}\n" + text


def _pairs(text: str) -> Iterator[_Pair]:
    section = ""
    for number, line in enumerate(text.splitlines()):
        header, match = _SECTION.match(line), _PAIR.match(line)
        if header:
            section = header["name"].strip()
        elif match:
            yield _Pair(section, match["key"], number, match.start("value"), match.end("value"))


def _sections(text: str) -> set[str]:
    matches = (_SECTION.match(line) for line in text.splitlines())
    return {match["name"].strip() for match in matches if match}


def _end_of(section: str, lines: list[str]) -> int:
    """Return the index after the last line of a section that is not empty."""
    inside, end = False, 0
    for number, line in enumerate(lines):
        header = _SECTION.match(line)
        inside = header["name"].strip() == section if header else inside
        end = number + 1 if inside and line.strip() else end
    return end


def _formatted(key: str, value: bool | int | float | str) -> str:
    words = option_text(value)
    if "\n" in words or "\r" in words:
        raise DefinitionError(f"the value of '{key}' has a line break, which an INI file cannot hold")
    return words
