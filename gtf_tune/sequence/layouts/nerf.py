"""Read transforms.json of NeRF, instant-ngp and nerfstudio."""

import json
import math
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
from natsort import natsorted
from numpy.typing import NDArray

from gtf_tune.errors import SequenceError
from gtf_tune.sequence.camera import Camera
from gtf_tune.sequence.images import image_size, is_image
from gtf_tune.sequence.layouts.base import Layout, Recording, one_camera
from gtf_tune.sequence.layouts.folder import counted_frames
from gtf_tune.sequence.layouts.ground_truth import poses_from_matrices
from gtf_tune.sequence.layouts.tables import read_text

_NAMES = ("transforms.json", "transforms_train.json")

# From OpenGL's camera axes (right, up, backward) to OpenCV's (right, down, forward).
_OPENGL_FROM_OPENCV = np.diag([1.0, -1, -1, 1])

_FISHEYE = {"OPENCV_FISHEYE", "EQUIDISTANT"}


def _file(root: Path) -> Path | None:
    if root.is_file():
        return root if root.suffix == ".json" else None
    return next((root / name for name in _NAMES if (root / name).is_file()), None)


def _read(root: Path) -> Recording:
    path = _file(root) or root / _NAMES[0]
    values = _parse(path)
    entries = natsorted(values["frames"], key=lambda entry: str(entry["file_path"]))
    frames = counted_frames(_image(path.parent, str(entry["file_path"])) for entry in entries)
    matrices = np.stack([_matrix(entry, path) for entry in entries])
    size = image_size(frames[0].path)
    camera, notes = one_camera([_camera({**values, **entry}, size, path) for entry in entries])
    ground_truth = poses_from_matrices(frames, matrices @ _OPENGL_FROM_OPENCV, path)
    return Recording(frames, camera, ground_truth, has_timestamps=False, notes=notes)


def _parse(path: Path) -> dict[str, Any]:
    try:
        values = json.loads(read_text(path))
        frames = values["frames"]
        complete = bool(frames) and all({"file_path", "transform_matrix"} <= set(frame) for frame in frames)
    except (json.JSONDecodeError, KeyError, TypeError) as error:
        raise _malformed(path) from error
    if not complete:
        raise _malformed(path)
    return dict(values)


def _malformed(path: Path) -> SequenceError:
    return SequenceError(
        f"{path}: expected JSON with 'frames' that have file_path and transform_matrix; check the file"
    )


def _image(folder: Path, name: str) -> Path:
    """Return the image of a frame; NeRF's own scenes leave the suffix out."""
    path = folder / name
    return path if is_image(path) else path.with_name(f"{path.name}.png")


def _matrix(entry: Mapping[str, Any], path: Path) -> NDArray[np.float64]:
    matrix = np.array(entry["transform_matrix"], dtype=np.float64)
    if matrix.shape != (4, 4):
        raise SequenceError(f"{path}: expected a 4x4 transform_matrix for {entry['file_path']}, found {matrix.shape}")
    return matrix


def _camera(values: Mapping[str, Any], size: tuple[int, int], path: Path) -> Camera:
    """Return the intrinsics; principal points come from COLMAP and so have its pixel centres."""
    width, height = int(values.get("w", size[0])), int(values.get("h", size[1]))
    focal = values.get("fl_x")
    if focal is None:
        angle = values.get("camera_angle_x")
        if angle is None:
            raise SequenceError(f"{path}: expected fl_x or camera_angle_x, found neither; give the camera instead")
        focal = width / (2 * math.tan(float(angle) / 2))
    pinhole = (focal, values.get("fl_y", focal), values.get("cx", width / 2), values.get("cy", height / 2))
    fisheye = str(values.get("camera_model", "")).upper() in _FISHEYE
    names = ("k1", "k2", "k3", "k4") if fisheye else ("k1", "k2", "p1", "p2")
    distortion = tuple(float(values.get(name, 0.0)) for name in names)
    if not fisheye and not any(distortion):
        return Camera("PINHOLE", width, height, pinhole)
    return Camera("OPENCV_FISHEYE" if fisheye else "OPENCV", width, height, (*pinhole, *distortion))


NERF = Layout(
    name="nerf",
    matches=lambda root: _file(root) is not None,
    read=_read,
    help=(
        "NeRF, instant-ngp or nerfstudio data: give the folder that holds transforms.json (or transforms_train.json) "
        "and the images, or the file itself."
    ),
)
