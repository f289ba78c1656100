"""Read the multi-view sets of Strecha et al. (CVPR 2008): one .camera file for each photograph."""

from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from gtf_tune.errors import SequenceError
from gtf_tune.sequence.camera import Camera, pinhole_from_matrix
from gtf_tune.sequence.images import image_size, is_image
from gtf_tune.sequence.layouts.base import Layout, Recording, one_camera
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


def _read(root: Path) -> Recording:
    images, folder = _folders(root)
    frames = counted_frames(list_images(images))
    described = [_read_camera_file(_camera_file(folder, frame.path), frame.path) for frame in frames]
    camera, notes = one_camera([camera for camera, _ in described])
    poses = poses_from_matrices(frames, np.stack([pose for _, pose in described]), folder)
    return Recording(frames, camera, poses, has_timestamps=False, notes=notes)


def _camera_file(folder: Path, image: Path) -> Path:
    """Return the camera file of an image; the sets name it after the image, whatever format that was first."""
    exact = folder / f"{image.name}{_SUFFIX}"
    return exact if exact.is_file() else next(iter(sorted(folder.glob(f"{image.stem}.*{_SUFFIX}"))), exact)


def _read_camera_file(path: Path, image: Path) -> tuple[Camera, NDArray[np.float64]]:
    """Return the camera and the 3x4 world_from_camera pose.

    The file holds K (3x3), three zeros, the world_from_camera rotation (3x3), the centre (3), and the image size.
    """
    numbers = read_numbers(path)
    if len(numbers) < _NUMBERS - 2:
        raise SequenceError(
            f"{path}: expected K, 0 0 0, R and the centre, found {len(numbers)} numbers; check the file"
        )
    intrinsics, rotation, centre = numbers[:9].reshape(3, 3), numbers[12:21].reshape(3, 3), numbers[21:24]
    size = (int(numbers[24]), int(numbers[25])) if len(numbers) >= _NUMBERS else image_size(image)
    return pinhole_from_matrix(intrinsics, size), np.column_stack([rotation, centre])


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
