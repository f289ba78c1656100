"""Edit single values of YAML files line by line; nothing is parsed into objects and no tag is executed.

OpenCV's ``%YAML:1.0`` files, which YAML libraries refuse, are included: keys may hold dots, the space after a colon may
be missing, and there are no booleans.
"""

import json
import re
from dataclasses import dataclass, field
from typing import Literal

from gtf_tune.errors import DefinitionError
from gtf_tune.pipelines.command.settings_files.scalars import read_scalar

_OPENCV = re.compile(r"\ufeff?%YAML[: ]1\.0")
_KEY = re.compile(r"""(?P<indent> *)(?P<key>"[^"]*"|'[^']*'|[^\s#'"\[\]{},&*!|>%@`?-][^#]*?)\s*:(?=\s|$)""")
_OPENCV_KEY = re.compile(r"""(?P<indent> *)(?P<key>[A-Za-z_][\w.\-]*)\s*:(?!:)""")
_SEQUENCE = "[]"

_Kind = Literal["scalar", "block", "flow", "tagged"]


@dataclass
class _Entry:
    """Where a key and its value stand; ``last_line`` is the last line of what belongs to the key."""

    path: tuple[str, ...]
    indent: int
    line: int
    start: int
    end: int
    kind: _Kind
    last_line: int = 0

    @property
    def key(self) -> str:
        return ".".join(self.path)

    @property
    def addressable(self) -> bool:
        return _SEQUENCE not in self.path


@dataclass
class _Scan:
    """Walk through the lines of a file once and note its keys."""

    opencv: bool
    entries: list[_Entry] = field(default_factory=list)
    open_entries: list[_Entry] = field(default_factory=list)
    skip_deeper_than: int | None = None
    pending: str = ""

    def read(self, number: int, line: str) -> None:
        """Take in one line without its line break."""
        stripped = line.strip()
        indent = len(line) - len(line.lstrip(" "))
        if self.pending:
            self.pending = _unfinished(self.pending + "\n" + line)
        elif self.skip_deeper_than is not None and (not stripped or indent > self.skip_deeper_than):
            self._extend(number, bool(stripped))
        elif stripped and not stripped.startswith("#"):
            self.skip_deeper_than = None
            self._read_content(number, line, indent)

    def _read_content(self, number: int, line: str, indent: int) -> None:
        if line.startswith(("---", "...", "%")):
            self.open_entries.clear()
            return
        match = (_OPENCV_KEY if self.opencv else _KEY).match(line)
        if match:
            self._close(indent)
            self._add_key(number, line, match)
        elif line.lstrip(" ").startswith("-"):
            self._open_item(number, indent)
            self.pending = _unfinished(line)
        else:
            self.pending = _unfinished(line)
            last = self.open_entries[-1] if self.open_entries else None
            if last is not None and last.kind == "scalar" and indent > last.indent:  # its value goes on
                last.kind = "block"
        self._extend(number, True)

    def _add_key(self, number: int, line: str, match: re.Match[str]) -> None:
        parents = self.open_entries[-1].path if self.open_entries else ()
        path = (*parents, match["key"].strip("\"'"))
        rest = line[match.end() :]
        start = match.end() + len(rest) - len(rest.lstrip())
        end = start + _value_length(line[start:])
        kind = _kind(line[start:end])
        self.entries.append(_Entry(path, len(match["indent"]), number, start, end, kind))
        self.open_entries.append(self.entries[-1])
        if line[start : start + 1] in ("|", ">"):
            self.skip_deeper_than = len(match["indent"])
        else:
            self.pending = _unfinished(line[start:])
            if self.pending and kind == "scalar":
                self.entries[-1].kind = "block"

    def _open_item(self, number: int, indent: int) -> None:
        while self.open_entries and (
            self.open_entries[-1].indent > indent
            or (self.open_entries[-1].indent == indent and self.open_entries[-1].path[-1] == _SEQUENCE)
        ):
            self.open_entries.pop()
        parents = self.open_entries[-1].path if self.open_entries else ()
        self.open_entries.append(_Entry((*parents, _SEQUENCE), indent, number, 0, 0, "block"))

    def _close(self, indent: int) -> None:
        while self.open_entries and self.open_entries[-1].indent >= indent:
            self.open_entries.pop()

    def _extend(self, number: int, counts: bool) -> None:
        if counts:
            for entry in self.open_entries:
                entry.last_line = number


def keys(text: str) -> tuple[str, ...]:
    """Return the dotted paths of all keys, those of mappings included; items of sequences have none."""
    return tuple(entry.key for entry in _entries(text) if entry.addressable)


def values(text: str) -> dict[str, bool | int | float | str]:
    """Return every single value by its dotted path."""
    lines = text.splitlines()
    scalars = [entry for entry in _entries(text) if entry.addressable and entry.kind == "scalar"]
    return {entry.key: read_scalar(lines[entry.line][entry.start : entry.end]) for entry in scalars}


def replace(text: str, key: str, value: bool | int | float | str) -> str:
    """Return the text with another value at a key that is there once and holds a single value."""
    found = [entry for entry in _entries(text) if entry.addressable and entry.key == key]
    if len(found) != 1:
        raise DefinitionError(f"the settings file has the key '{key}' {len(found)} times; it must have it once")
    entry = found[0]
    if entry.kind != "scalar":
        raise DefinitionError(f"the key '{key}' of the settings file does not hold a single value; give a longer path")
    lines = text.splitlines(keepends=True)
    line = lines[entry.line]
    before = line[: entry.start] if line[entry.start - 1].isspace() else line[: entry.start] + " "
    lines[entry.line] = before + _formatted(value, _is_opencv(text)) + line[entry.end :]
    return "".join(lines)


def add(text: str, key: str, value: bool | int | float | str) -> str:
    """Return the text with a new key, below the deepest mapping of its path that is there."""
    if text and not text.endswith("\n"):
        text += "\n"
    words = _formatted(value, _is_opencv(text))
    if _is_opencv(text):
        return f"{text}{key}: {words}\n"
    entries = _entries(text)
    parents = [entry for entry in entries if entry.addressable and key.startswith(entry.key + ".")]
    if not parents:
        return text + _nested(key, words, 0)
    parent = max(parents, key=lambda entry: len(entry.key))
    children = [entry for entry in entries if entry.path[:-1] == parent.path and entry.addressable]
    if not children or parent.kind != "block":
        raise DefinitionError(
            f"the key '{key}' cannot be added to the settings file, where '{parent.key}' holds no keys on lines of "
            "their own; write it there by hand"
        )
    lines = text.splitlines(keepends=True)
    lines.insert(parent.last_line + 1, _nested(key.removeprefix(parent.key + "."), words, children[0].indent))
    return "".join(lines)


def _nested(key: str, words: str, indent: int) -> str:
    parts = key.split(".")
    outer = "".join(f"{' ' * (indent + 2 * depth)}{part}:\n" for depth, part in enumerate(parts[:-1]))
    return f"{outer}{' ' * (indent + 2 * (len(parts) - 1))}{parts[-1]}: {words}\n"


def _entries(text: str) -> list[_Entry]:
    scan = _Scan(_is_opencv(text))
    for number, line in enumerate(text.splitlines()):
        scan.read(number, line)
    return scan.entries


def _is_opencv(text: str) -> bool:
    return _OPENCV.match(text) is not None


def _kind(value: str) -> _Kind:
    if not value or value[0] in "|>":
        return "block"
    if value[0] in "[{":
        return "flow"
    return "tagged" if value[0] in "!&*" else "scalar"


def _value_length(text: str) -> int:
    """Return how many characters of the rest of a line belong to the value, without its comment."""
    quoted = re.match(r""""(?:[^"\\]|\\.)*"|'(?:[^']|'')*'""", text)
    if quoted:
        return quoted.end()
    comment = re.search(r"(?:^|\s)#", text)
    return len(text[: comment.start()].rstrip() if comment else text.rstrip())


def _unfinished(text: str) -> str:
    """Return the text of a flow collection or quoted value that goes on in the next line, otherwise nothing."""
    if text.lstrip(" -")[:1] not in ("[", "{", '"', "'") and "[" not in text and "{" not in text:
        return ""
    depth, quote, previous = 0, "", ""
    for character in re.sub(r"(?m)(^|\s)#.*$", "", text):
        if quote:
            quote = "" if character == quote and previous != "\\" else quote
        elif character in "\"'" and previous in " \t\n,[{:":
            quote = character
        else:
            depth += (character in "[{") - (character in "]}")
        previous = character
    return text if depth > 0 or quote else ""


def _formatted(value: bool | int | float | str, opencv: bool) -> str:
    if isinstance(value, bool):
        return str(int(value)) if opencv else str(value).lower()
    if isinstance(value, float):
        mantissa, exponent, power = repr(value).partition("e")
        # YAML 1.1 takes 1e-05 for a text.
        return mantissa + ("" if "." in mantissa else ".0") + exponent + power
    return str(value) if isinstance(value, int) else json.dumps(value, ensure_ascii=False)
