"""Read numbers, and the plain tables of them, as data sets are described in."""

import io
import math
import re
from collections.abc import Sequence as Items
from dataclasses import dataclass
from pathlib import Path, PurePosixPath, PureWindowsPath

import numpy as np
from numpy.typing import NDArray

from gtf_tune.errors import SequenceError
from gtf_tune.sequence.image_formats import IMAGE_SUFFIXES, is_image
from gtf_tune.sequence.layouts.base import check_unique
from gtf_tune.sequence.value import Frame
from gtf_tune.trajectory.columns import time_column
from gtf_tune.trajectory.formats import PER_SECOND, epoch_unit

_NANOSECOND_DIGITS = 30
_NUMBER = re.compile(r"[+-]?(\d+\.?\d*|\.\d+)([eE][+-]?\d+)?", re.ASCII)
_WORDS = frozenset({"nan", "inf", "infinity"})
_SHOWN = 40
_CONTROL = re.compile(r"[\x00-\x1f\x7f]")


def read_text(path: Path) -> str:
    """Return the text of a regular file, or raise `SequenceError` that names it.

    A named pipe or a device is refused: reading one may never end.
    """
    try:
        return io.TextIOWrapper(io.BytesIO(read_bytes(path)), encoding="utf-8-sig").read()
    except UnicodeDecodeError as error:
        raise SequenceError(f"{path}: expected a text file, found other bytes; check the download") from error


def read_bytes(path: Path) -> bytes:
    """Return the bytes of a regular file, or raise `SequenceError` that names it."""
    try:
        if path.exists() and not path.is_file():
            raise SequenceError(f"{path}: expected a file, found a folder, a pipe or a device; check the path")
        return path.read_bytes()
    except OSError as error:
        raise SequenceError(f"{path}: cannot read the file ({error.strerror}); check the path") from error


def read_rows(path: Path, separator: str | None = None, columns: int = 0) -> list[tuple[int, list[str]]]:
    """Return (line number from 1, fields) of each line that is neither empty nor a comment that starts with ``#``.

    With ``columns``, what would be more fields stays in the last one, such as a file name with spaces.
    """
    rows = []
    for number, line in enumerate(read_text(path).split("\n"), start=1):
        content = line.strip()
        if content and not content.startswith("#"):
            rows.append((number, [field.strip() for field in content.split(separator, columns - 1)]))
    return rows


def to_numbers(fields: list[str], path: Path, line: int) -> list[float]:
    """Return the fields as finite numbers, or raise `SequenceError` that names file and line."""
    numbers = _to_floats(fields, path, line)
    if not all(math.isfinite(number) for number in numbers):
        raise SequenceError(f"{path}:{line}: expected finite numbers, found '{_shown(fields)}'; correct the line")
    return numbers


def to_nanoseconds(field: str, path: Path, line: int) -> float:
    """Return the seconds of a whole number of nanoseconds since some time, or raise `SequenceError`."""
    if not (field.isascii() and field.isdecimal() and len(field) <= _NANOSECOND_DIGITS):
        raise SequenceError(
            f"{path}:{line}: expected a time in whole nanoseconds, found '{shortened(field)}'; correct the line"
        )
    return int(field) * 1e-9


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
    numbers = [parse_number(field) for field in fields]
    found = [number for number in numbers if number is not None]
    if len(found) < len(fields):
        raise SequenceError(f"{path}:{line}: expected numbers, found '{_shown(fields)}'; correct the line")
    return found


def _shown(fields: list[str]) -> str:
    return shortened(" ".join(fields))


def parse_number(text: str) -> float | None:
    """Return the number that a text is, NaN and infinity included, or ``None`` where it is none.

    Unlike `float` it takes no underscores, no foreign digits and no words but these. What is too large for a float is
    infinite.
    """
    plain = text.strip()
    if _NUMBER.fullmatch(plain) or plain.lstrip("+-").lower() in _WORDS:
        return float(plain)
    return None


def parse_finite(text: str) -> float | None:
    """Return the finite number that a text is, or ``None``."""
    number = parse_number(text)
    return number if number is not None and math.isfinite(number) else None


def shortened(text: str) -> str:
    """Return a text for a message, in one line, cut where it is long."""
    text = _CONTROL.sub(" ", text)
    return text if len(text) <= _SHOWN else f"{text[:_SHOWN]}..."


_LONGEST_NAME = 4096


def find_listed(folder: Path, name: str, source: Path) -> Path:
    """Return the image that ``source`` calls ``name`` relative to ``folder``, whether it is there or not.

    Where there is no such file, backslashes may separate folders, and an absolute path of another machine is looked
    for by as many of its last parts as lie below ``folder``.

    Raises
    ------
    SequenceError
        The name is none that a file can have.
    """
    if not name.strip() or _CONTROL.search(name) or len(name) > _LONGEST_NAME:
        raise SequenceError(f"{source}: expected the name of an image, found '{shortened(name)}'; check the file")
    exact = folder / name
    if _is_file(exact):
        return exact
    parts = PureWindowsPath(name).parts if "\\" in name else PurePosixPath(name).parts
    relative = [part for part in parts if part != PureWindowsPath(name).anchor and part != "/"]
    if exact.is_dir():
        raise SequenceError(f"{source}: expected the name of an image, found that of a folder; check the file")
    tails = (folder.joinpath(*relative[start:]) for start in range(len(relative)))
    return next((path for path in tails if _is_file(path)), exact)


def with_suffix(path: Path) -> Path:
    """Return the image that a name without its suffix means; NeRF's own scenes leave it out."""
    if is_image(path) and (_is_file(path) or not _is_file(_png(path))):
        return path
    candidates = (path.with_name(f"{path.name}{suffix}") for suffix in sorted(IMAGE_SUFFIXES))
    return next((candidate for candidate in candidates if _is_file(candidate)), _png(path))


def _png(path: Path) -> Path:
    return path.with_name(f"{path.name}.png")


def _is_file(path: Path) -> bool:
    try:
        return path.is_file()
    except (OSError, ValueError):
        return False


_SEPARATOR = re.compile(r"\s*[,;]\s*|\s+")
_LONGEST_WHOLE = 30
_ASSOCIATED = 3


@dataclass(frozen=True)
class _List:
    """Lines of (line number from 1, time, image), and the unit of the times; empty where no header says it."""

    lines: tuple[tuple[int, str, str], ...]
    unit: str


def read_image_list(path: Path, folder: Path, usual_unit: str) -> tuple[Frame, ...]:
    """Return the frames of a file of lines ``time image``, separated by a blank, a comma or a semicolon.

    Times are in the unit that the header names, else in that in which they can be times since 1970, else in the usual
    one, and become seconds. The header may stand in a comment or in the first line. Images are relative to ``folder``.

    Raises
    ------
    SequenceError
        A line is of another kind, an image or a time occurs twice, or there are none.
    """
    found = _read_list(path)
    if not found.lines:
        raise SequenceError(f"{path}: lists no images; give a sequence that has some")
    times = in_seconds([(line, text) for line, text, _ in found.lines], found.unit, usual_unit, path)
    frames = tuple(
        Frame(number, find_listed(folder, name, path), time)
        for number, ((_, _, name), time) in enumerate(zip(found.lines, times, strict=True))
    )
    check_unique(frames, path)
    return frames


def _read_list(path: Path) -> _List:
    time, unit = 0, ""
    lines: list[tuple[int, str, str]] = []
    for number, line in enumerate(read_text(path).split("\n"), start=1):
        content = line.strip()
        named = None if lines or not content else time_column(content.lstrip("# "), 2)
        if named:
            time, unit = named
        elif content and not content.startswith("#"):
            if time and not lines and parse_number(_cut(content, time, f"{path}:{number}")[0]) is None:
                time, unit = 0, ""  # the comment was prose
            lines.append((number, *_cut(content, time, f"{path}:{number}")))
    return _List(tuple(lines), unit)


def _cut(content: str, time: int, where: str) -> tuple[str, str]:
    """Return time and image of a line; only the name of the image may contain what separates them.

    Of a line ``time image time depth`` the first two count.
    """
    places = list(_SEPARATOR.finditer(content))
    if len(places) == _ASSOCIATED and is_image(Path(content[places[0].end() : places[1].start()])):
        content, places = content[: places[1].start()], places[:1]
    if not places or not content[places[0].end() :]:
        raise SequenceError(f"{where}: expected 'timestamp image', found '{shortened(content)}'; correct the line")
    place = places[-1 if time else 0]
    fields = content[: place.start()], content[place.end() :]
    return fields[time], fields[1 - time]


def in_seconds(stamps: Items[tuple[int, str]], unit: str, usual_unit: str, path: Path) -> list[float]:
    """Return times in seconds, from their lines in a file and their texts.

    An empty ``unit`` means that of times since 1970, else the usual one.

    Raises
    ------
    SequenceError
        A text is no time, or nothing says the unit.
    """
    numbers = [_number(text, path, line) for line, text in stamps]
    known = unit or epoch_unit(numbers) or usual_unit
    if not known:
        raise SequenceError(f"{path}: nothing says the unit of its times; write it into the header, such as 'ts (ns)'")
    if known != "ns":
        return [number / PER_SECOND[known] for number in numbers]
    return [
        to_nanoseconds(str(int(number)) if number == int(number) else text, path, line)
        for number, (line, text) in zip(numbers, stamps, strict=True)
    ]


def _number(text: str, path: Path, line: int) -> float:
    """Return a time; a whole number stays one, as a float has too few digits for nanoseconds since 1970."""
    if text.isascii() and text.isdecimal() and len(text) <= _LONGEST_WHOLE:
        return int(text)
    return to_numbers([text], path, line)[0]
