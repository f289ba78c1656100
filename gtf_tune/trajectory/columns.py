"""Cut the lines of a text file of poses into columns, and find out from its header what each column holds."""

import re
from dataclasses import dataclass
from pathlib import Path
from types import MappingProxyType

from gtf_tune.errors import TrajectoryError

ROLES = ("time", "x", "y", "z", "qx", "qy", "qz", "qw")
"""What a pose consists of, in TUM's order."""

_FEWEST_NAMES = 4
"""A comment that names fewer parts of a pose than this is prose that happens to have as many words as columns."""

_SHORTEST_UNIT = 3
_DECIMAL_COMMA = re.compile(r"[+-]?[0-9]+(,[0-9]+)?")
_BRACKETS = re.compile(r"\s*[\[(]([^\])]*)[\])]")
_UNITS = MappingProxyType(
    {
        "s": re.compile(r"s|secs?|seconds?"),
        "ms": re.compile(r"ms|msecs?|milliseconds?"),
        "us": re.compile(r"[uµμ]s|usecs?|microseconds?"),
        "ns": re.compile(r"ns|nsecs?|nanoseconds?"),
    }
)
_TIME = re.compile(r"(?:.*[./])?(?:time_?stamps?|times?|stamp|ts|t)[\[_]?(?P<unit>[a-zµμ]*)\]?")
_COUNT = re.compile(r"(?:frame|image)(?:_?(?:id|idx|index|num|number))?|idx|index|id")
_AXIS = re.compile(r"(?P<prefix>.*?)[._/]*(?P<axis>[xyzw])(?:\[.*\])?")
_ROTATION_WORDS = frozenset({"q", "quat", "quaternion", "orientation", "rotation", "rot", "r"})
_POSITION_WORDS = frozenset({"t", "p", "pos", "position", "pose", "trans", "translation", "loc", "location"})


@dataclass(frozen=True)
class Columns:
    """Where the parts of a pose stand in a line.

    ``order`` holds the columns of `ROLES`, from 0; ``unit`` is that of the times, empty where nothing says it.
    """

    order: tuple[int, ...]
    unit: str = ""


@dataclass(frozen=True)
class Table:
    """Lines of a text file, cut into columns.

    Attributes
    ----------
    headers
        Comments, and at most one line of words, above the first line of numbers.
    rows
        The place of each line of numbers, for messages, and its columns; there is at least one.
    separator
        What stands between columns; ``None`` for blanks.
    """

    headers: tuple[str, ...]
    rows: tuple[tuple[str, list[str]], ...]
    separator: str | None

    def named_columns(self, usual: Columns | None = None) -> Columns | None:
        """Return the columns as the header names them, or ``None`` where there is no header.

        A header that names only some parts of a pose, each where it is in the ``usual`` columns, means these.

        Raises
        ------
        TrajectoryError
            The header names some parts of a pose, but not each exactly once.
        """
        where, first = self.rows[0]
        for header in reversed(self.headers):
            names = _names(header, self.separator, len(first))
            roles = [_role(name) for name in names]
            if sum(role in ROLES for role in roles) >= _FEWEST_NAMES:
                return _columns(names, roles, where, usual)
        return None


def read_table(text: str, path: Path, delimiter: str | None = None) -> Table:
    """Cut a text into columns; without a ``delimiter``, the first line of numbers shows what separates them.

    Raises
    ------
    TrajectoryError
        There is no line of numbers.
    """
    headers: list[str] = []
    lines: list[tuple[str, str]] = []
    titled = False
    for number, line in enumerate(text.split("\n"), start=1):
        content = line.strip()
        if content.startswith(("#", "%")):
            headers += [] if lines else [content.lstrip("#% ")]
        elif content and not lines and not titled and _has_only_words(content, delimiter):
            headers, titled = [*headers, content], True
        elif content:
            lines.append((f"{path}, line {number}", content))
    if not lines:
        raise TrajectoryError(f"expected at least one pose in {path}, but it holds none")
    separator = _separator(lines[0][1]) if delimiter is None else delimiter.strip(" ") or None
    return Table(tuple(headers), tuple((where, _cut(content, separator)) for where, content in lines), separator)


def time_column(header: str, count: int) -> tuple[int, str] | None:
    """Return the one of ``count`` columns that a header calls a time, and its unit, empty where it does not say it.

    ``None`` where no column is called so, or several are.
    """
    units = [_unit(name) for name in _names(header, ",", count)]
    found = [(column, unit) for column, unit in enumerate(units) if unit is not None]
    return found[0] if len(found) == 1 else None


def time_unit(title: str) -> str | None:
    """Return the unit of a column of times by its title, empty where that does not say it, ``None`` for others."""
    found = time_column(title, 1)
    return found[1] if found else None


def _has_only_words(line: str, delimiter: str | None) -> bool:
    words = line.replace(delimiter, " ") if delimiter else line
    return not any(_is_number(token) for token in re.split(r"[\s,;|]+", words))


def _is_number(token: str) -> bool:
    try:
        float(token)
    except ValueError:
        return False
    return True


def _separator(line: str) -> str | None:
    words = line.split()
    if len(words) > 1 and all(_DECIMAL_COMMA.fullmatch(word) for word in words):
        return None
    return next((separator for separator in (";", ",") if separator in line), None)


def _cut(line: str, separator: str | None) -> list[str]:
    if separator is None:
        return line.split()
    return [token.strip() for token in line.removesuffix(separator).split(separator)]


def _names(header: str, separator: str | None, count: int) -> list[str]:
    """Return the names of ``count`` columns, units in brackets; empty where a header has another number of names."""
    glued = _BRACKETS.sub(lambda found: f"[{found[1].replace(' ', '')}]", header.lower())
    for tried in (separator, ",", ";", None):
        names = [name.strip("\"'") for name in _cut(glued, tried)]
        if len(names) == count:
            return names
    return []


def _role(name: str) -> str:
    """Return what a column holds: one of `ROLES`, ``count`` for numbers of frames, or an empty text."""
    if _unit(name) is not None:
        return "time"
    if _COUNT.fullmatch(name):
        return "count"
    found = _AXIS.fullmatch(name)
    if found is None:
        return ""
    words = re.split(r"[._/]", found["prefix"])
    if _ROTATION_WORDS & ({*words} if words[0] not in ("p", "v", "b") else set()):
        return f"q{found['axis']}"
    placed = words == [""] or words[0] == "p" or words[-1] in _POSITION_WORDS
    return found["axis"] if placed and found["axis"] != "w" else ""


def _unit(name: str) -> str | None:
    """Return the unit of a column of times, empty where its name does not say it; ``None`` for other columns."""
    found = _TIME.fullmatch(name)
    written = found["unit"] if found else name
    if found and not written:
        return ""
    known = next((unit for unit, spellings in _UNITS.items() if spellings.fullmatch(written)), None)
    # A column that is called only s or ms need not hold times.
    return known if found or len(written) >= _SHORTEST_UNIT else None


def _columns(names: list[str], roles: list[str], where: str, usual: Columns | None) -> Columns:
    if "time" not in roles:
        roles = ["time" if role == "count" else role for role in roles]
    if roles.count("time") > 1:
        stamped = [role == "time" and "stamp" in name for name, role in zip(names, roles, strict=True)]
        roles = [
            "" if role == "time" and not kept and any(stamped) else role
            for role, kept in zip(roles, stamped, strict=True)
        ]
    expected = dict(zip(usual.order, ROLES, strict=True)) if usual else {}
    agreed = {column: role for column, role in enumerate(roles) if role in ROLES}
    if len(agreed) < len(ROLES) and agreed.items() <= expected.items():
        roles = [expected.get(column, "") for column in range(len(names))]
    unclear = [role for role in ROLES if roles.count(role) != 1]
    if unclear:
        raise TrajectoryError(
            f"{where}: the header above it, '{' '.join(names)}', does not name exactly one column as "
            f"{', '.join(unclear)}; call the columns timestamp tx ty tz qx qy qz qw, in the order that they have"
        )
    return Columns(tuple(roles.index(role) for role in ROLES), _unit(names[roles.index("time")]) or "")
