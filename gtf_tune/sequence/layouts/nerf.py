"""Read transforms.json of NeRF, instant-ngp and nerfstudio."""

from collections import Counter
from dataclasses import replace
from pathlib import Path

import numpy as np
from natsort import natsorted

from gtf_tune.errors import SequenceError
from gtf_tune.sequence.images import image_size
from gtf_tune.sequence.layouts.base import Intrinsics, Layout, Reading, Recording
from gtf_tune.sequence.layouts.cameras.nerf_lens import CAMERA_KEYS, lens_camera
from gtf_tune.sequence.layouts.fields import Field, read_json
from gtf_tune.sequence.layouts.folder import counted_frames
from gtf_tune.sequence.layouts.ground_truth import poses_from_matrices
from gtf_tune.sequence.layouts.tables import find_listed, with_suffix

_NAMES = ("transforms.json", "transforms_train.json")

# Signs of the columns: from OpenGL's camera axes (right, up, backward) to OpenCV's (right, down, forward).
_OPENGL_FROM_OPENCV = np.array([1.0, -1, -1, 1])

# What trains or draws a radiance field, or moved the whole world; it bears neither on camera nor on poses.
_OTHER_KEYS = frozenset(
    [
        "frames",
        "aabb_scale",
        "scale",
        "offset",
        "from_na",
        "up",
        "render_aabb",
        "n_frames",
        "aabb",
        "sharpness",
        "colmap_im_id",
        "ply_file_path",
        "depth_file_path",
        "depth_path",
        "mask_path",
        "integer_depth_scale",
        "enable_depth_loading",
        "n_extra_learnable_dims",
        "applied_transform",
        "applied_scale",
        "rotation",
        "white_transparent",
        "black_transparent",
        "train_filenames",
        "val_filenames",
        "test_filenames",
        "fps",
        "bg_color",
        "time",
    ]
)


def _file(root: Path) -> Path | None:
    if root.is_file():
        return root if root.suffix == ".json" else None
    return next((root / name for name in _NAMES if (root / name).is_file()), None)


def _read(root: Path, _: Reading) -> Recording:
    path = _file(root) or root / _NAMES[0]
    values = read_json(path)
    entries = natsorted(_entries(values), key=lambda entry: entry["file_path"].text())
    frames = counted_frames(_image(path, entry) for entry in entries)
    _refuse_repeated([frame.path for frame in frames], path)
    matrices = np.stack([entry["transform_matrix"].matrix(4, 4) for entry in entries])

    def read_intrinsics() -> Intrinsics:
        lenses = [replace(entry, defaults=values) for entry in entries]
        sizes = _sizes(lenses, [frame.path for frame in frames])
        return Intrinsics(tuple(lens_camera(lens, size) for lens, size in zip(lenses, sizes, strict=True)))

    return Recording(
        frames,
        read_intrinsics,
        poses_from_matrices(frames, matrices * _OPENGL_FROM_OPENCV, path),
        has_timestamps=False,
        notes=_unread(values, entries),
        files=(path,),
    )


def _entries(values: Field) -> list[Field]:
    entries = list(values["frames"].items())
    if not entries:
        raise values["frames"].fault("a list of frames with file_path and transform_matrix")
    return entries


def _image(path: Path, entry: Field) -> Path:
    return with_suffix(find_listed(path.parent, entry["file_path"].text(), path))


def _sizes(lenses: list[Field], images: list[Path]) -> list[tuple[int, int]]:
    """Return the (width, height) of each image; those whose lens has its own are not looked at."""
    return [
        (0, 0) if "w" in lens and "h" in lens else image_size(image) for lens, image in zip(lenses, images, strict=True)
    ]


def _refuse_repeated(images: list[Path], path: Path) -> None:
    counted = Counter(images)
    for image in images:
        if counted[image] > 1:
            raise SequenceError(f"{path}: names the image {image.name} twice; remove one of the frames")


def _unread(values: Field, entries: list[Field]) -> tuple[str, ...]:
    """Return a note on keys that may bear on camera or poses and are not read."""
    known = CAMERA_KEYS | _OTHER_KEYS | {"file_path", "transform_matrix"}
    others = dict.fromkeys(name for field in (values, *entries) for name in field.others(known))
    return (f"{values.path.name} has keys that are not read: {', '.join(others)}",) if others else ()


NERF = Layout(
    name="nerf",
    matches=lambda root: _file(root) is not None,
    read=_read,
    help=(
        "NeRF, instant-ngp or nerfstudio data: give the folder that holds transforms.json (or transforms_train.json) "
        "and the images, or the file itself."
    ),
)
