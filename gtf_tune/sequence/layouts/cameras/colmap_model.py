"""Read the cameras of a COLMAP model, text or binary."""

import struct
from pathlib import Path

from gtf_tune.errors import SequenceError
from gtf_tune.sequence.camera import MODEL_PARAMS, Camera
from gtf_tune.sequence.layouts.base import naming
from gtf_tune.sequence.layouts.tables import read_bytes, read_rows, to_numbers

_MODELS = tuple(MODEL_PARAMS)
_COUNT = struct.Struct("<Q")
_HEAD = struct.Struct("<IiQQ")


class ModelCameras:
    """Cameras of a model by their ids; only those that are asked for must make sense.

    ``cameras.bin`` is taken where both files exist, as COLMAP does.

    Raises
    ------
    SequenceError
        The file cannot be read or holds something else.
    """

    def __init__(self, model: Path) -> None:
        binary = model / "cameras.bin"
        self._path = binary if binary.is_file() else model / "cameras.txt"
        self._cameras = _read_binary(binary) if binary.is_file() else _read_text(self._path)

    def of(self, camera_id: int) -> Camera:
        """Return one camera, or raise `SequenceError` if there is no such one or it is malformed."""
        if camera_id not in self._cameras:
            raise SequenceError(f"{self._path}: has no camera {camera_id}, which an image uses; check the model")
        name, size, params = self._cameras[camera_id]
        with naming(self._path):
            if any(side != int(side) for side in size):
                raise SequenceError(f"expected the image size of camera {camera_id} in whole pixels; check the model")
            return Camera(name, int(size[0]), int(size[1]), params)


# Model, width and height, parameters.
_Entry = tuple[str, tuple[float, float], tuple[float, ...]]


def _read_text(path: Path) -> dict[int, _Entry]:
    cameras: dict[int, _Entry] = {}
    for line, fields in read_rows(path):
        if len(fields) < 5 or not (fields[0].isascii() and fields[0].isdecimal() and len(fields[0]) <= 10):
            raise SequenceError(
                f"{path}:{line}: expected 'id MODEL width height parameters', found {len(fields)} fields; check it"
            )
        width, height, *params = to_numbers(fields[2:], path, line)
        cameras[int(fields[0])] = fields[1], (width, height), tuple(params)
    return cameras


def _read_binary(path: Path) -> dict[int, _Entry]:
    """Read a count (u64), then for each camera: id (u32), model (i32), width, height (u64), parameters (f64)."""
    data = read_bytes(path)
    cameras: dict[int, _Entry] = {}
    at = _COUNT.size
    try:
        for _ in range(*_COUNT.unpack_from(data)):
            camera_id, model, width, height = _HEAD.unpack_from(data, at)
            if not 0 <= model < len(_MODELS):
                raise SequenceError(
                    f"{path}: camera {camera_id} has model number {model}, which COLMAP 4 does not know"
                )
            count = len(MODEL_PARAMS[_MODELS[model]].split())
            params = struct.unpack_from(f"<{count}d", data, at + _HEAD.size)
            cameras[camera_id] = _MODELS[model], (width, height), params
            at += _HEAD.size + 8 * count
    except (struct.error, OverflowError) as error:
        raise SequenceError(
            f"{path}: expected COLMAP cameras, found other bytes at {at}; write the model again"
        ) from error
    return cameras
