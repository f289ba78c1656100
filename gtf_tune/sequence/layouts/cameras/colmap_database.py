"""Read the cameras of photographs from the database that COLMAP keeps beside them."""

import sqlite3
import struct
from contextlib import closing
from pathlib import Path

from gtf_tune.errors import SequenceError
from gtf_tune.sequence.camera import MODEL_PARAMS, Camera
from gtf_tune.sequence.images import image_size
from gtf_tune.sequence.layouts.base import UNKNOWN, Intrinsics
from gtf_tune.sequence.value import Frame

_MODELS = tuple(MODEL_PARAMS)
_QUERY = """
    SELECT images.name, cameras.model, cameras.width, cameras.height, cameras.params, cameras.prior_focal_length
    FROM images JOIN cameras ON images.camera_id = cameras.camera_id
"""
_TOLERANCE = 1e-9

_Row = tuple[object, ...]


def database_of(root: Path) -> Path:
    """Return where the database of a folder of photographs is: in it, or beside a folder ``images``."""
    beside = root.parent / "database.db"
    return beside if root.name == "images" and beside.is_file() else root / "database.db"


def database_intrinsics(path: Path, frames: tuple[Frame, ...]) -> Intrinsics:
    """Return the cameras that the images have in a database, or only their focal lengths, and a note on them.

    A camera with a distortion or a principal point of its own was calibrated and is known. One with nothing but a focal
    length has it from EXIF or by hand: it is where to start from. Whatever else is in the database is noted, and the
    intrinsics count as unknown: that COLMAP has worked on the images before is no fault of theirs.
    """
    if not path.is_file():
        return UNKNOWN
    try:
        rows = _cameras_of(path, frames)
        if len(set(rows)) == 1:
            rows, frames = rows[:1], frames[:1]
        found = {row: _described(row, frame) for row, frame in zip(rows, frames, strict=True)}
    except (SequenceError, sqlite3.Error) as error:
        return _unknown(path, f"cannot be used ({error})")
    if not any(camera or prior for camera, prior in found.values()):
        return _unknown(path, "has a camera without a focal length of its own")
    cameras, priors = zip(*(found[row] for row in rows), strict=True)
    return Intrinsics(cameras, (_note(path, list(found.values())),), priors)


def _unknown(path: Path, reason: str) -> Intrinsics:
    return Intrinsics(notes=(f"{path.name} {reason}: intrinsics count as unknown",))


_Described = tuple[Camera | None, float | None]


def _note(path: Path, found: list[_Described]) -> str:
    if len(found) > 1:
        known = sum(camera is not None for camera, _ in found)
        return f"{len(found)} cameras come from {path.name}, {known} of them with known intrinsics"
    [(camera, prior)] = found
    if camera is None:
        return f"{path.name} has only a focal length, {prior:.5g} pixels: it is where the pipeline starts from"
    return f"intrinsics come from {path.name}, as COLMAP was given them"


def _described(row: _Row | None, frame: Frame) -> _Described:
    """Return the intrinsics of a camera, or only its focal length in pixels; neither where it has no prior."""
    if row is None or not row[-1]:
        return None, None
    camera = _camera(*row[:-1]).fitted(*image_size(frame.path))
    values = dict(zip(camera.param_names, camera.params, strict=True))
    focal = values.pop("fx", values.pop("f", 0.0))
    usual = {"fy": focal, "cx": camera.width / 2, "cy": camera.height / 2}
    if focal and all(abs(value - usual.get(name, 0.0)) <= _TOLERANCE * focal for name, value in values.items()):
        return None, focal
    return camera, None


def _cameras_of(path: Path, frames: tuple[Frame, ...]) -> list[_Row | None]:
    """Return the camera of each image, (model, width, height, parameters, prior); ``None`` where it is not in there.

    Where all that are in there share one camera, it is taken for the others too.
    """
    with closing(_connected(path)) as connection:
        rows = {str(name): tuple(camera) for name, *camera in connection.execute(_QUERY)}
    tails = ([Path(*frame.path.parts[-count:]).as_posix() for count in (3, 2, 1)] for frame in frames)
    found = [next((rows[tail] for tail in names if tail in rows), None) for names in tails]
    different = set(found) - {None}
    if not different:
        raise SequenceError(f"it has {len(rows)} images, but none of these")
    return [next(iter(different))] * len(found) if len(different) == 1 else found


def _connected(path: Path) -> sqlite3.Connection:
    """Open a database to read it; one that no program has open is not touched, so that its folder may be read-only."""
    log = path.with_name(f"{path.name}-wal")
    in_use = log.is_file() and log.stat().st_size > 0
    return sqlite3.connect(f"{path.absolute().as_uri()}?mode=ro{'' if in_use else '&immutable=1'}", uri=True)


def _camera(model: object, width: object, height: object, params: object) -> Camera:
    if not (isinstance(model, int) and isinstance(width, int) and isinstance(height, int)):
        raise SequenceError("it has no whole number as the model or the size of its camera")
    if not 0 <= model < len(_MODELS):
        raise SequenceError(f"it has camera model {model}, which COLMAP 4 does not know")
    count = len(MODEL_PARAMS[_MODELS[model]].split())
    if not isinstance(params, bytes) or len(params) != 8 * count:
        raise SequenceError(f"it has other parameters of its camera than the {count} of {_MODELS[model]}")
    return Camera(_MODELS[model], width, height, struct.unpack(f"<{count}d", params))
