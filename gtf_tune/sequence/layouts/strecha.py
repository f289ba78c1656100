"""Read the multi-view sets of Strecha et al. (CVPR 2008): one .camera file for each photograph."""

import glob
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from gtf_tune.errors import SequenceError
from gtf_tune.sequence.camera import Camera, pinhole_from_matrix
from gtf_tune.sequence.image_formats import is_image
from gtf_tune.sequence.images import image_size
from gtf_tune.sequence.layouts.base import GIVE_THE_CAMERA, Intrinsics, Layout, Reading, Recording, naming
from gtf_tune.sequence.layouts.folder import counted_frames, list_images
from gtf_tune.sequence.layouts.ground_truth import poses_from_matrices
from gtf_tune.sequence.layouts.tables import read_numbers

_SUFFIX = ".camera"
_NUMBERS = 26


def _folders(root: Path) -> tuple[Path, Path]:
    """Return the folders of the images and of the camera files, which may be one."""
    candidates = [root, *sorted(path for path in root.iterdir() if path.is_dir())]
    cameras = next((folder for folder in candidates if any(folder.glob(f"*{_SUFFIX}"))), root)
    images = next((folder for folder in candidates if any(is_image(path) for path in folder.iterdir())), root)
    return images, cameras


def _matches(root: Path) -> bool:
    if not root.is_dir():
        return False
    images, cameras = _folders(root)
    return any(cameras.glob(f"*{_SUFFIX}")) and any(is_image(path) for path in images.iterdir())


def _read(root: Path, _: Reading) -> Recording:
    images, folder = _folders(root)
    frames = counted_frames(list_images(images))
    files = [_camera_file(folder, frame.path) for frame in frames]
    matrices = np.stack([_read_pose(path) for path in files])

    def read_intrinsics() -> Intrinsics:
        pairs = zip(files, frames, strict=True)
        return Intrinsics(tuple(_read_camera(path, frame.path) for path, frame in pairs))

    poses = poses_from_matrices(frames, matrices, folder)
    return Recording(frames, read_intrinsics, poses, has_timestamps=False, files=tuple(files))


def _camera_file(folder: Path, image: Path) -> Path:
    """Return the camera file of an image; the sets name it after the image, whatever format that was first."""
    exact = folder / f"{image.name}{_SUFFIX}"
    stem = glob.escape(image.stem)
    return exact if exact.is_file() else next(iter(sorted(folder.glob(f"{stem}.*{_SUFFIX}"))), exact)


def _read_pose(path: Path) -> NDArray[np.float64]:
    """Return the 3x4 world_from_camera pose, a gap where the image has no camera file."""
    if not path.is_file():
        return np.full((3, 4), np.nan)
    numbers = _read_file(path)
    return np.column_stack([numbers[12:21].reshape(3, 3), numbers[21:24]])


def _read_camera(path: Path, image: Path) -> Camera:
    numbers = _read_file(path)
    if numbers[9:12].any():
        raise SequenceError(f"{path}: expected no distortion (0 0 0 after K), found some; {GIVE_THE_CAMERA}")
    stored = image_size(image) if len(numbers) < _NUMBERS else None
    with naming(path):
        size = stored or (_side(numbers[24]), _side(numbers[25]))
        return pinhole_from_matrix(numbers[:9].reshape(3, 3), size)


def _read_file(path: Path) -> NDArray[np.float64]:
    """Return K (3x3), three zeros, the world_from_camera rotation (3x3), the centre (3), and mostly the image size."""
    numbers = read_numbers(path)
    if len(numbers) not in (_NUMBERS, _NUMBERS - 2):
        raise SequenceError(
            f"{path}: expected K, 0 0 0, R, the centre and the size, found {len(numbers)} numbers; check the file"
        )
    return numbers


def _side(number: float) -> int:
    if number < 1 or number != int(number):
        raise SequenceError(f"expected the size of the image in pixels, found {number:g}; check the file")
    return int(number)


STRECHA = Layout(
    name="strecha",
    matches=_matches,
    read=_read,
    help=(
        "Strecha's multi-view sets (fountain-P11, Herz-Jesu-P8, ...; https://documents.epfl.ch/groups/c/cv/cvlab-unit/www/"
        "data/multiview/denseMVS.html): put the undistorted images and their .camera files into one folder, or into "
        "two subfolders of it, and give that folder."
    ),
)
