"""Read the camera poses of a COLMAP model, text or binary.

COLMAP stores cam_from_world with the scalar part of quaternions first; a trajectory holds world_from_camera with the
scalar part last. COLMAP 4 adds rigs and frames, but its images files keep the pose of every registered image.
"""

import re
import struct
from collections.abc import Iterator, Sequence
from itertools import pairwise
from pathlib import Path, PurePosixPath
from typing import NamedTuple

import numpy as np
from scipy.spatial.transform import Rotation

from gtf_tune.errors import TrajectoryError
from gtf_tune.trajectory.formats import (
    PER_SECOND,
    checked_quaternion,
    epoch_unit,
    finite_numbers,
    read_binary,
    read_text,
)
from gtf_tune.trajectory.value import FloatArray, IntArray, Trajectory

_IMAGE_COLUMNS = 10
_POINT_COLUMNS = 3
_COUNT = struct.Struct("<Q")
_IMAGE = struct.Struct("<I7dI")
_POINT_BYTES = 24
_LONGEST_ID = 10
_BELOW = ("*/images.bin", "*/images.txt", "*/*/images.bin", "*/*/images.txt")
_NAMED = 4
_NUMBERED = re.compile(r"(?P<prefix>.*?)(?P<number>[0-9]{1,19})", re.DOTALL)
_TIME = re.compile(r"[0-9]+(?:\.[0-9]+)?")
_LARGEST_ID = np.iinfo(np.int64).max


class _Image(NamedTuple):
    """Image of a model: its name, quaternion w, x, y, z and translation of cam_from_world, and id of its camera."""

    name: str
    quaternion: tuple[float, ...]
    translation: tuple[float, ...]
    camera_id: int


def read_colmap(path: Path) -> Trajectory:
    """Read a model folder, an ``images.bin`` or an ``images.txt``; the names are those of the images.

    Poses are in the natural order of the names (2.png before 10.png). Where the names of all files differ only in a
    whole number at the end, as in ``000012.png`` or ``frame_00012.jpg``, these numbers are the frame ids; else frame
    ids count poses from 0 (``ids_are_counted``). COLMAP knows no times (``has_timestamps``): timestamps are frame ids,
    unless images are called by times: ``1305031102.175304.png`` (seconds), ``1403636579763555584.png`` (nanoseconds
    since 1970).

    Raises
    ------
    TrajectoryError
        There is no such file, or it is malformed or without poses.
    """
    images = list(_images(path))
    if not images:
        raise TrajectoryError(f"expected at least one registered image in {path}, but it holds none")
    world_from_camera = Rotation.from_quat(np.array([image.quaternion for image in images])[:, [1, 2, 3, 0]]).inv()
    positions = -world_from_camera.apply(np.array([image.translation for image in images]))
    return named_trajectory([image.name for image in images], positions, world_from_camera, path)


def named_trajectory(
    names: Sequence[str], positions: FloatArray, world_from_camera: Rotation, path: Path
) -> Trajectory:
    """Return poses of named images in the natural order of the names; see `read_colmap` for frame ids and times.

    Parameters
    ----------
    names, positions, world_from_camera
        One for each pose: the name of its image, the position of its camera, (n, 3), and its rotation.
    path
        The file for messages.

    Raises
    ------
    TrajectoryError
        An image comes twice.
    """
    if len(set(names)) != len(names):
        raise TrajectoryError(f"expected every image once in {path}, but one name comes twice")
    order = sorted(range(len(names)), key=lambda index: _natural(names[index]))
    ordered = tuple(names[index] for index in order)
    stems = [PurePosixPath(name).stem for name in ordered]
    frame_ids, counted = _frame_ids(stems)
    times = _times(stems)
    return Trajectory(
        frame_ids=frame_ids,
        timestamps=frame_ids.astype(np.float64) if times is None else times,
        positions=positions[order],
        quaternions=world_from_camera.as_quat()[order],
        names=ordered,
        ids_are_counted=counted,
        has_timestamps=times is not None,
    )


def read_camera_ids(path: Path) -> dict[str, int]:
    """Return the id of the camera of each registered image of a model folder, by the name of the image.

    Raises
    ------
    TrajectoryError
        There is no such file, or it is malformed.
    """
    return {image.name: image.camera_id for image in _images(path)}


def _images(path: Path) -> Iterator[_Image]:
    file = path
    if path.is_dir():
        found = [path / name for name in ("images.bin", "images.txt") if (path / name).is_file()]
        if not found:
            raise TrajectoryError(
                f"expected a COLMAP model with images.bin or images.txt in {path}, but there is none{_below(path)}"
            )
        file = found[0]
    return _binary_images(file) if file.suffix == ".bin" else _text_images(file)


def _below(folder: Path) -> str:
    """Return a hint at models in the folders of a project, empty where there are none."""
    found = sorted(
        {file.parent for pattern in _BELOW for file in folder.glob(pattern)}, key=lambda model: _natural(str(model))
    )
    named = ", ".join(str(model.relative_to(folder)) for model in found[:_NAMED])
    return f"; give one of {named}" if found else ""


def _text_images(path: Path) -> Iterator[_Image]:
    """Yield images of lines ``IMAGE_ID QW QX QY QZ TX TY TZ CAMERA_ID NAME``, each followed by a line of points."""
    lines = iter(enumerate(read_text(path).split("\n"), start=1))
    for number, line in lines:
        if line.strip() and not line.startswith("#"):
            yield _text_image(line.strip(), f"{path}, line {number}")
            number, points = next(lines, (number + 1, ""))
            _check_points(points.split(), f"{path}, line {number}")


def _text_image(text: str, where: str) -> _Image:
    expected = "'IMAGE_ID QW QX QY QZ TX TY TZ CAMERA_ID NAME'"
    tokens = text.split(maxsplit=_IMAGE_COLUMNS - 1)
    if len(tokens) != _IMAGE_COLUMNS:
        raise TrajectoryError(f"{where}: expected {expected}, not {len(tokens)} columns")
    if "\0" in tokens[9]:
        raise TrajectoryError(f"{where}: expected an image name without zero bytes; the file is damaged")
    numbers = finite_numbers(tokens[1:8], where, expected)
    if not (tokens[8].isascii() and tokens[8].isdecimal() and len(tokens[8]) <= _LONGEST_ID):
        raise TrajectoryError(f"{where}: expected {expected}, but CAMERA_ID is no whole number")
    return _Image(tokens[9], checked_quaternion(numbers[:4], where), numbers[4:], int(tokens[8]))


def _check_points(tokens: list[str], where: str) -> None:
    # Without its line of points an image would swallow the next one.
    if len(tokens) % _POINT_COLUMNS or (tokens and not _is_whole(tokens[-1])):
        raise TrajectoryError(
            f"{where}: expected the image's points 'X Y POINT3D_ID ...' or an empty line, not an image"
        )


def _is_whole(token: str) -> bool:
    return token.removeprefix("-").isdigit()


def _binary_images(path: Path) -> Iterator[_Image]:
    data = read_binary(path)
    count = _count(data, 0, f"{path}")
    offset = _COUNT.size
    for index in range(count):
        where = f"{path}, image {index + 1} of {count}"
        _, *numbers, camera_id = _unpack(_IMAGE, data, offset, where)
        name, offset = _binary_name(data, offset + _IMAGE.size, where)
        offset += _COUNT.size + _POINT_BYTES * _count(data, offset, where)
        if not np.isfinite(numbers).all():
            raise TrajectoryError(f"{where}: expected finite numbers, but its pose is NaN or infinite")
        yield _Image(name, checked_quaternion(tuple(numbers[:4]), where), tuple(numbers[4:]), int(camera_id))
    if offset != len(data):
        raise TrajectoryError(
            f"expected {offset} bytes in {path}, not {len(data)}; it is cut short or of another format"
        )


def _unpack(layout: struct.Struct, data: bytes, offset: int, where: str) -> tuple[float, ...]:
    if offset + layout.size > len(data):
        raise TrajectoryError(
            f"{where}: expected more than the {len(data)} bytes there are; the file is cut short or no images.bin"
        )
    return layout.unpack_from(data, offset)


def _count(data: bytes, offset: int, where: str) -> int:
    return int(_unpack(_COUNT, data, offset, where)[0])


def _binary_name(data: bytes, start: int, where: str) -> tuple[str, int]:
    end = data.find(b"\0", start)
    if end < 0:
        raise TrajectoryError(f"{where}: expected an image name that ends in a zero byte; the file is cut short")
    try:
        return data[start:end].decode(), end + 1
    except UnicodeDecodeError as error:
        raise TrajectoryError(f"{where}: expected an image name in UTF-8; the file is damaged") from error


def _natural(name: str) -> tuple[list[tuple[int, str]], str]:
    """Return a key that sorts runs of digits by their value, then names as they are."""
    parts = re.split(r"([0-9]+)", name)
    digits = [part.lstrip("0") for part in parts[1::2]]
    key = [(-1, part) for part in parts]
    key[1::2] = [(len(number), number) for number in digits]
    return key, name


def _frame_ids(stems: list[str]) -> tuple[IntArray, bool]:
    """Return the frame ids, (n,), and whether they only count the names."""
    found = [_NUMBERED.fullmatch(stem) for stem in stems]
    numbers = [int(match["number"]) for match in found if match]
    prefixes = {match["prefix"] if match else None for match in found}
    if len(prefixes) == 1 and None not in prefixes and numbers[-1] <= _LARGEST_ID and _increase(numbers):
        return np.array(numbers, dtype=np.int64), False
    return np.arange(len(stems), dtype=np.int64), True


def _times(stems: list[str]) -> FloatArray | None:
    """Return the times, (n,) in seconds, that the images are called by; ``None`` where they are not."""
    if not all(_TIME.fullmatch(stem) for stem in stems):
        return None
    numbers = [float(stem) if "." in stem else int(stem) for stem in stems]
    unit = "s" if all("." in stem for stem in stems) else epoch_unit(numbers)
    if unit is None or not _increase(numbers):
        return None
    return np.array([number / PER_SECOND[unit] for number in numbers])


def _increase(numbers: Sequence[float]) -> bool:
    return all(before < after for before, after in pairwise(numbers))
