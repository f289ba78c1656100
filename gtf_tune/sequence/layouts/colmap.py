"""Read images beside a COLMAP model that serves as ground truth; ETH3D's multi-view scenes come so."""

import os
from collections.abc import Mapping
from pathlib import Path

import numpy as np
from natsort import natsorted

from gtf_tune.errors import GtfTuneError, SequenceError
from gtf_tune.sequence.image_formats import is_image
from gtf_tune.sequence.layouts.base import Intrinsics, Layout, Notes, Reading, Recording, naming, one_camera
from gtf_tune.sequence.layouts.cameras.colmap_model import ModelCameras
from gtf_tune.sequence.layouts.folder import counted_frames
from gtf_tune.sequence.layouts.ground_truth import check_near
from gtf_tune.sequence.layouts.tables import find_listed
from gtf_tune.trajectory import Trajectory, read_trajectory
from gtf_tune.trajectory.colmap import read_camera_ids

# A reconstruction may fall into several models, each in a subfolder of its own.
_PARENTS = ("sparse", "colmap/sparse")
_MODEL_FOLDERS = (
    "dslr_calibration_undistorted",
    "dslr_calibration_jpg",
    "rig_calibration_undistorted",
    "rig_calibration",
    ".",
)
_IMAGE_FOLDERS = ("images", ".")
_MODEL_FILES = ("cameras", "images", "points3D", "rigs", "frames")


def _models(root: Path) -> list[Path]:
    """Return the folders of the models of one reconstruction, in natural order; the first place that has any counts."""
    for parent in _PARENTS:
        folders = [*(path for path in natsorted((root / parent).glob("*")) if path.is_dir()), root / parent]
        found = [folder for folder in folders if _is_model(folder)]
        if found:
            return found
    return next(([root / name] for name in _MODEL_FOLDERS if _is_model(root / name)), [])


def _is_model(folder: Path) -> bool:
    return any(
        all((folder / f"{part}{suffix}").is_file() for part in ("cameras", "images")) for suffix in (".bin", ".txt")
    )


def _read(root: Path, _: Reading) -> Recording:
    models = _models(root)
    if not models:
        places = ", ".join((*(f"{parent}/0" for parent in _PARENTS), *_PARENTS, *_MODEL_FOLDERS))
        raise SequenceError(
            f"{root}: expected a COLMAP model (cameras and images, .txt or .bin) in {places}; check the path"
        )
    model, camera_ids, notes = _largest(models, root)
    with naming(model):
        registered = read_trajectory(model, format="colmap")
        check_near(registered.positions, model)
    images = _images(_image_folder(root, registered.names), registered.names, model)
    frames = counted_frames(images.values())
    files = tuple(
        folder / f"{name}{suffix}" for folder in models for name in _MODEL_FILES for suffix in (".bin", ".txt")
    )
    return Recording(
        frames,
        lambda: _intrinsics(ModelCameras(model), camera_ids, list(images)),
        _by_name(registered, list(images)),
        has_timestamps=False,
        notes=notes,
        files=(*files, root / "database.db"),
    )


def _largest(models: list[Path], root: Path) -> tuple[Path, Mapping[str, int], Notes]:
    """Return the model with the most registered images, the camera of each image, and a note on the other models."""
    found: list[tuple[Path, dict[str, int]]] = []
    notes: list[str] = []
    for model in models:
        try:
            found.append((model, read_camera_ids(model)))
        except GtfTuneError as error:
            if len(models) == 1:
                raise
            notes.append(f"{model.relative_to(root)} is left out: {error}")
    if not found:
        raise SequenceError(notes[0])
    model, camera_ids = max(found, key=lambda pair: len(pair[1]))
    others = [f"{other.relative_to(root)} ({len(ids)})" for other, ids in found if other != model]
    if others:
        chosen = f"{model.relative_to(root)} has the most images of {len(found)} models ({len(camera_ids)})"
        notes.append(f"{chosen}; the others are not used: {', '.join(others)}")
    return model, camera_ids, tuple(notes)


def _image_folder(root: Path, names: tuple[str, ...]) -> Path:
    """Return the folder that the model's image names start from: images/, the folder itself, or another one in it."""
    others = (path.name for path in natsorted(root.iterdir()) if path.is_dir() and not path.name.startswith("."))
    for name in dict.fromkeys((*_IMAGE_FOLDERS, *others)):
        if any((root / name / image.replace("\\", "/")).is_file() for image in names):
            return root / name
    raise SequenceError(
        f"{root}: found none of the model's {len(names)} images (such as {next(iter(names), 'none')}) in "
        f"{' or '.join(_IMAGE_FOLDERS)} or another subfolder; put the images there, or give the folder that "
        "holds both"
    )


def _images(folder: Path, registered: tuple[str, ...], model: Path) -> dict[str, Path]:
    """Return all images beside the registered ones by name, in natural order: frames may lack a pose."""
    found = {name: find_listed(folder, name, model) for name in registered}
    if len(set(found.values())) < len(found):
        raise SequenceError(f"{model}: two registered images are one file in {folder}; check the names in the model")
    known = set(found.values())
    for parent in {path.parent for path in known}:
        others = (path for path in parent.glob("*") if is_image(path) and path not in known)
        found |= {Path(os.path.relpath(path, folder)).as_posix(): path for path in others}
    return {name: found[name] for name in natsorted(found)}


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


def _intrinsics(cameras: ModelCameras, camera_ids: Mapping[str, int], names: list[str]) -> Intrinsics:
    """Return the camera of each image; one that all registered images share is taken for those without a pose too."""
    used = {camera_id: cameras.of(camera_id) for camera_id in set(camera_ids.values())}
    if len(set(used.values())) == 1:
        return one_camera(next(iter(used.values())))
    return Intrinsics(tuple(used[camera_ids[name]] if name in camera_ids else None for name in names))


COLMAP = Layout(
    name="colmap",
    matches=lambda root: root.is_dir() and bool(_models(root)),
    read=_read,
    help=(
        "Any COLMAP project: give the folder that holds images/ and sparse/0/; of several models the largest is ground "
        "truth. ETH3D multi-view (https://www.eth3d.net/datasets): unpack a scene's undistorted images and calibration "
        "and give its folder, such as courtyard, which holds images/ and dslr_calibration_undistorted/."
    ),
)
