"""Read images beside a COLMAP model that serves as ground truth; ETH3D's multi-view scenes come so."""

import struct
from pathlib import Path

import numpy as np
from natsort import natsorted

from gtf_tune.errors import SequenceError
from gtf_tune.sequence.camera import MODEL_PARAMS, Camera
from gtf_tune.sequence.images import is_image
from gtf_tune.sequence.layouts.base import Layout, Recording, one_camera
from gtf_tune.sequence.layouts.folder import counted_frames
from gtf_tune.sequence.layouts.tables import read_rows, to_numbers
from gtf_tune.trajectory import Trajectory, read_trajectory

_MODEL_FOLDERS = (
    "sparse/0",
    "sparse",
    "dslr_calibration_undistorted",
    "dslr_calibration_jpg",
    "rig_calibration_undistorted",
    "rig_calibration",
    ".",
)
_IMAGE_FOLDERS = ("images", ".")
_MODELS = tuple(MODEL_PARAMS)


def _model_folder(root: Path) -> Path | None:
    for name in _MODEL_FOLDERS:
        for suffix in (".bin", ".txt"):
            if all((root / name / f"{part}{suffix}").is_file() for part in ("cameras", "images")):
                return root / name
    return None


def _read(root: Path) -> Recording:
    model = _model_folder(root)
    if model is None:
        raise SequenceError(
            f"{root}: expected a COLMAP model (cameras and images, .txt or .bin) in {', '.join(_MODEL_FOLDERS)}; "
            "check the path"
        )
    registered = read_trajectory(model, format="colmap")
    folder = _image_folder(root, registered.names)
    names = _image_names(folder, registered.names)
    camera, notes = one_camera(_read_cameras(model))
    frames = counted_frames(folder / name for name in names)
    return Recording(frames, camera, _by_name(registered, names), has_timestamps=False, notes=notes)


def _image_folder(root: Path, names: tuple[str, ...]) -> Path:
    """Return the folder that the model's image names start from."""
    for name in _IMAGE_FOLDERS:
        if any((root / name / image).is_file() for image in names):
            return root / name
    raise SequenceError(
        f"{root}: found none of the model's {len(names)} images (such as {next(iter(names), 'none')}) in "
        f"{' or '.join(_IMAGE_FOLDERS)}; put the images there"
    )


def _image_names(folder: Path, registered: tuple[str, ...]) -> list[str]:
    """Return the names of all images beside the registered ones, in natural order: frames may lack a pose."""
    found = set(registered)
    for parent in {(folder / name).parent for name in registered}:
        found |= {str(path.relative_to(folder)) for path in parent.glob("*") if is_image(path)}
    return list(natsorted(found))


def _by_name(registered: Trajectory, names: list[str]) -> Trajectory:
    frame_ids = {name: number for number, name in enumerate(names)}
    ids = np.array([frame_ids[name] for name in registered.names], dtype=np.int64)
    order = np.argsort(ids)
    return Trajectory(
        frame_ids=ids[order],
        timestamps=ids[order].astype(np.float64),
        positions=registered.positions[order],
        quaternions=registered.quaternions[order],
    )


def _read_cameras(model: Path) -> list[Camera]:
    """Return the cameras of a model; cameras.bin is taken where both files exist, as COLMAP does."""
    binary = model / "cameras.bin"
    return _read_binary(binary) if binary.is_file() else _read_text(model / "cameras.txt")


def _read_text(path: Path) -> list[Camera]:
    cameras = []
    for line, fields in read_rows(path):
        if len(fields) < 5:
            raise SequenceError(
                f"{path}:{line}: expected 'id MODEL width height parameters', found {len(fields)} fields"
            )
        width, height, *params = to_numbers(fields[2:], path, line)
        cameras.append(Camera(fields[1], int(width), int(height), tuple(params)))
    return cameras


def _read_binary(path: Path) -> list[Camera]:
    """Read a count (u64), then for each camera: id (u32), model (i32), width, height (u64), parameters (f64)."""
    data = path.read_bytes()
    cameras, at = [], 8
    try:
        for _ in range(*struct.unpack_from("<Q", data)):
            _, model, width, height = struct.unpack_from("<IiQQ", data, at)
            name = _MODELS[model]
            count = len(MODEL_PARAMS[name].split())
            cameras.append(Camera(name, width, height, struct.unpack_from(f"<{count}d", data, at + 24)))
            at += 24 + 8 * count
    except (struct.error, IndexError) as error:
        raise SequenceError(
            f"{path}: expected COLMAP cameras, found other bytes at {at}; write the model again"
        ) from error
    return cameras


COLMAP = Layout(
    name="colmap",
    matches=lambda root: root.is_dir() and _model_folder(root) is not None,
    read=_read,
    help=(
        "Any COLMAP project: give the folder that holds images/ and sparse/0/. ETH3D multi-view "
        "(https://www.eth3d.net/datasets): unpack a scene's undistorted images and calibration and give its folder, "
        "such as courtyard, which holds images/ and dslr_calibration_undistorted/."
    ),
)
