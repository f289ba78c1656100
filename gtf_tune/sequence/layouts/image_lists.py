"""Read files that list images with their times: rgb.txt of TUM RGB-D, data.csv of EuRoC."""

import re
from collections.abc import Sequence as Items
from dataclasses import dataclass
from pathlib import Path

from gtf_tune.errors import SequenceError
from gtf_tune.sequence.image_formats import is_image
from gtf_tune.sequence.layouts.base import check_unique
from gtf_tune.sequence.layouts.tables import find_listed, parse_number, read_text, shortened, to_nanoseconds, to_numbers
from gtf_tune.sequence.value import Frame
from gtf_tune.trajectory.columns import time_column
from gtf_tune.trajectory.formats import PER_SECOND, epoch_unit

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
