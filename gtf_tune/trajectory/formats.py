"""Read trajectory files that hold one pose a line: TUM, KITTI and EuRoC."""

import math
import re
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path
from types import MappingProxyType

import numpy as np
from scipy.spatial.transform import Rotation

from gtf_tune.errors import TrajectoryError
from gtf_tune.trajectory.columns import Columns, Table, read_table
from gtf_tune.trajectory.value import FloatArray, Trajectory

UNIT_TOLERANCE = 1e-2
"""How far rounded rotations may be from unit length; farther off they are other numbers in the wrong columns."""

_TUM = Columns(tuple(range(8)))
_EUROC = Columns((0, 1, 2, 3, 5, 6, 7, 4), "ns")
_TUM_EXPECTED = "8 numbers 'timestamp tx ty tz qx qy qz qw'"
_EUROC_EXPECTED = "at least 8 columns 'timestamp [ns], px, py, pz, qw, qx, qy, qz'"
KITTI_COLUMNS = (12, 16)
"""How many columns a file of matrices has: 3x4, or 4x4 as some programs write them."""

_LARGEST_COSINE = 1 + UNIT_TOLERANCE
_DECIMAL_COMMA = re.compile(r"[+-]?[0-9]+,[0-9]+")

PER_SECOND = MappingProxyType({"s": 1, "ms": 1_000, "us": 1_000_000, "ns": 1_000_000_000})
_EPOCH_S = (1e8, 5e9)
"""Recordings are from 1973 to 2128: whatever unit their times since 1970 are in, no two of them can be confused."""


@dataclass(frozen=True)
class TextLayout:
    """How a program writes its text file of poses, where that is not as usual.

    Attributes
    ----------
    delimiter
        What separates columns; ``None`` for what the first line shows.
    time_scale
        What times are multiplied by to make them seconds; ``None`` for what the header, or their size, shows.
    sort
        Whether lines are put in the order of time; otherwise lines out of order are an error.
    repeats
        Whether several lines may have the same time; otherwise they are an error. All of them are returned.
    """

    delimiter: str | None = None
    time_scale: float | None = None
    sort: bool = False
    repeats: bool = False


_USUAL = TextLayout()


def read_tum(path: Path, layout: TextLayout = _USUAL) -> Trajectory:
    """Read lines of ``timestamp tx ty tz qx qy qz qw``, world_from_camera, timestamps in seconds.

    A header that names the columns decides on their order and on the unit of the timestamps. Where it names no unit,
    timestamps that can only be milli-, micro- or nanoseconds since 1970 are taken for these.
    """
    table = read_table(read_text(path), path, layout.delimiter)
    columns = table.named_columns(_TUM)
    width = len(table.rows[0][1]) if columns else len(_TUM.order)
    for where, tokens in table.rows:
        if len(tokens) != width:
            expected = f"{width} columns as in the first line" if columns else _TUM_EXPECTED
            raise TrajectoryError(f"{where}: expected {expected}, not {len(tokens)} columns")
    return _trajectory(table, columns or _TUM, layout, _TUM_EXPECTED)


def read_euroc(path: Path, layout: TextLayout = _USUAL) -> Trajectory:
    """Read lines of ``timestamp [ns], px, py, pz, qw, qx, qy, qz, ...``, as in EuRoC's ground-truth folders.

    These are poses of the body, or of the marker, not of a camera. A header that names the columns decides on their
    order and on the unit of the timestamps.
    """
    table = read_table(read_text(path), path, layout.delimiter or ",")
    columns = table.named_columns(_EUROC) or _EUROC
    for where, tokens in table.rows:
        if len(tokens) <= max(columns.order):
            raise TrajectoryError(f"{where}: expected {_EUROC_EXPECTED} separated by commas, not {len(tokens)}")
        if columns is _EUROC and not _is_whole(tokens[0]):
            raise TrajectoryError(f"{where}: expected a timestamp in whole nanoseconds, not '{tokens[0][:40]}'")
    whole = all(_is_whole(tokens[columns.order[0]]) for _, tokens in table.rows)
    return _trajectory(table, columns, layout, _EUROC_EXPECTED, "ns" if whole else "s")


def read_kitti(path: Path, layout: TextLayout = _USUAL) -> Trajectory:
    """Read lines of the 12 numbers of a (3, 4) matrix world_from_camera, row by row; frame ids only count the lines.

    Lines of the 16 numbers of a (4, 4) matrix are read too.
    """
    table = read_table(read_text(path), path, layout.delimiter)
    matrices = np.array([_kitti_matrix(where, tokens) for where, tokens in table.rows])
    turns = [_quaternion(matrix[:, :3], where) for matrix, (where, _) in zip(matrices, table.rows, strict=True)]
    count = np.arange(len(matrices))
    return Trajectory(
        frame_ids=count,
        timestamps=count.astype(np.float64),
        positions=matrices[:, :, 3],
        quaternions=np.array(turns),
        ids_are_counted=True,
        has_timestamps=False,
    )


def read_text(path: Path) -> str:
    """Return the text of a file.

    Raises
    ------
    TrajectoryError
        The file cannot be read or is not UTF-8.
    """
    try:
        return read_binary(path).decode("utf-8-sig")
    except UnicodeDecodeError as error:
        raise TrajectoryError(f"expected a text file, but {path} is not UTF-8 from byte {error.start} on") from error


def read_binary(path: Path) -> bytes:
    """Return the bytes of a file.

    Raises
    ------
    TrajectoryError
        The file cannot be read.
    """
    try:
        return path.read_bytes()
    except (OSError, ValueError) as error:
        reason = error.strerror if isinstance(error, OSError) else str(error)
        raise TrajectoryError(f"expected a readable trajectory file, but {path} is not ({reason})") from error


def finite_numbers(tokens: list[str], where: str, expected: str) -> tuple[float, ...]:
    """Return the tokens as numbers.

    Raises
    ------
    TrajectoryError
        One is not a finite number.
    """
    try:
        numbers = tuple(float(token) for token in tokens)
    except ValueError as error:
        hint = "; write decimal points, not commas" if any(map(_DECIMAL_COMMA.fullmatch, tokens)) else ""
        raise TrajectoryError(f"{where}: expected {expected} ({error}){hint}") from error
    if not all(math.isfinite(number) for number in numbers):
        raise TrajectoryError(f"{where}: expected {expected}, but a number is NaN or infinite; drop the line")
    return numbers


def checked_quaternion(quaternion: tuple[float, ...], where: str) -> tuple[float, ...]:
    """Return the quaternion if it has unit length but for rounding.

    Raises
    ------
    TrajectoryError
        It has not.
    """
    length = math.hypot(*quaternion)
    if abs(length - 1) > UNIT_TOLERANCE:
        raise TrajectoryError(f"{where}: expected a unit quaternion, but its length is {length:.6g}; check the columns")
    return quaternion


def _trajectory(table: Table, columns: Columns, layout: TextLayout, expected: str, usual_unit: str = "s") -> Trajectory:
    """Return the poses of a table; times without a unit have that in which they can be since 1970, or the usual one."""
    time, *parts = columns.order
    rows = [finite_numbers([tokens[part] for part in parts], where, expected) for where, tokens in table.rows]
    for (where, _), row in zip(table.rows, rows, strict=True):
        checked_quaternion(row[3:], where)
    stamps = [(where, tokens[time]) for where, tokens in table.rows]
    numbers = [_time(text, where, expected) for where, text in stamps]
    unit = columns.unit or epoch_unit(numbers) or usual_unit
    seconds = [_in_seconds(number, unit, layout, where) for number, (where, _) in zip(numbers, stamps, strict=True)]
    order = sorted(range(len(rows)), key=seconds.__getitem__) if layout.sort else list(range(len(rows)))
    for before, after in pairwise(order):
        if seconds[after] <= seconds[before] and not (layout.repeats and numbers[after] == numbers[before]):
            raise _not_later(stamps[before], stamps[after], numbers[after] > numbers[before])
    values = np.array(rows)[order]
    return Trajectory(
        frame_ids=np.arange(len(rows)),
        timestamps=np.array(seconds)[order],
        positions=values[:, :3],
        quaternions=values[:, 3:],
        ids_are_counted=True,
    )


def _time(text: str, where: str, expected: str) -> float:
    return int(text) if _is_whole(text) else finite_numbers([text], where, expected)[0]


def epoch_unit(numbers: Sequence[float]) -> str | None:
    """Return the unit in which numbers can be times since 1970, ``None`` where there is none."""
    (first, last), low, high = _EPOCH_S, min(numbers), max(numbers)
    return next((unit for unit, per in PER_SECOND.items() if first * per <= low and high <= last * per), None)


def _in_seconds(number: float, unit: str, layout: TextLayout, where: str) -> float:
    if layout.time_scale is not None:
        return number * layout.time_scale
    seconds = number / PER_SECOND[unit]
    if unit == "s" and seconds != number:
        raise _too_many_digits(where, f"{number} needs")
    return seconds


def _not_later(earlier: tuple[str, str], later: tuple[str, str], sorted_: bool) -> TrajectoryError:
    where, text = later
    if sorted_:
        return _too_many_digits(where, f"{earlier[1]} and {text} need")
    same = "drop the line, or write times with all their digits" if text == earlier[1] else "sort the file"
    return TrajectoryError(f"{where}: expected a later timestamp than the {earlier[1]} before it, not {text}; {same}")


def _too_many_digits(where: str, numbers: str) -> TrajectoryError:
    return TrajectoryError(
        f"{where}: expected timestamps that 64-bit numbers hold to the last digit, but {numbers} more than 53 bits; "
        "subtract one and the same number from the timestamps of every file that is compared"
    )


def _is_whole(text: str) -> bool:
    return re.fullmatch(r"[+-]?[0-9]{1,20}", text) is not None


def _kitti_matrix(where: str, tokens: list[str]) -> FloatArray:
    expected = f"the {KITTI_COLUMNS[0]} numbers of a 3x4 matrix"
    if len(tokens) not in KITTI_COLUMNS:
        raise TrajectoryError(f"{where}: expected {expected}, not {len(tokens)} columns")
    matrix = np.array(finite_numbers(tokens, where, expected)).reshape(-1, 4)
    if not np.array_equal(matrix[3:], np.eye(4)[3 : len(matrix)]):
        raise TrajectoryError(f"{where}: expected 0 0 0 1 as the last row of a 4x4 matrix, not another one")
    return matrix[:3]


def _quaternion(matrix: np.ndarray[tuple[int, int], np.dtype[np.float64]], where: str) -> tuple[float, ...]:
    small = bool((np.abs(matrix) <= _LARGEST_COSINE).all())
    if not small or np.abs(matrix @ matrix.T - np.eye(3)).max() > UNIT_TOLERANCE or np.linalg.det(matrix) < 0:
        raise TrajectoryError(
            f"{where}: expected a rotation in the first three columns of the 3x4 matrix, not another one"
        )
    return tuple(Rotation.from_matrix(matrix).as_quat().tolist())
