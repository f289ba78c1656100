"""Read KITTI odometry: rectified images, times.txt, calib.txt and the poses that come separately."""

from dataclasses import replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from gtf_tune.errors import SequenceError
from gtf_tune.sequence.camera import check_calibration_matrix, pinhole_from_matrix
from gtf_tune.sequence.images import image_size
from gtf_tune.sequence.layouts.base import (
    GIVE_THE_CAMERA,
    Intrinsics,
    Layout,
    Reading,
    Recording,
    check_unique,
    naming,
    one_camera,
)
from gtf_tune.sequence.layouts.folder import list_images
from gtf_tune.sequence.layouts.ground_truth import Notes, check_near, poses_by_line
from gtf_tune.sequence.layouts.tables import in_seconds, read_rows, to_numbers
from gtf_tune.sequence.value import Frame
from gtf_tune.trajectory import Trajectory, read_trajectory

_IMAGE_FOLDERS = {"image_0": "P0", "image_2": "P2"}
_KNOWN_LINES = frozenset({"P0", "P1", "P2", "P3", "Tr"})


def _matches(root: Path) -> bool:
    return (root / "times.txt").is_file() and any((root / folder).is_dir() for folder in _IMAGE_FOLDERS)


def _read(root: Path, _: Reading) -> Recording:
    folder = next((name for name in _IMAGE_FOLDERS if (root / name).is_dir()), "image_0")
    frames = _read_frames(root / folder, root / "times.txt")
    calibration = root / "calib.txt"
    poses = next((path for path in _pose_files(root) if path.is_file()), None)
    ground_truth, notes = _read_ground_truth(frames, poses, calibration, folder) if poses else (None, ())

    def read_intrinsics() -> Intrinsics:
        projection = _read_projection(calibration, _IMAGE_FOLDERS[folder])
        size = image_size(frames[0].path)
        with naming(calibration):
            camera = pinhole_from_matrix(projection, size)
        return one_camera(camera, *_unread_lines(calibration))

    files = (root / "times.txt", calibration, *((poses,) if poses else ()))
    return Recording(frames, read_intrinsics, ground_truth, notes=notes, files=files)


def _pose_files(root: Path) -> tuple[Path, ...]:
    return root / "poses.txt", root / f"{root.name}.txt", root.parent.parent / "poses" / f"{root.name}.txt"


def _read_frames(folder: Path, times: Path) -> tuple[Frame, ...]:
    rows = [(line, field) for line, fields in read_rows(times) for field in fields]
    stamps = in_seconds(rows, "", "s", times) if rows else []
    images = list_images(folder)
    if len(stamps) != len(images):
        raise SequenceError(
            f"{times}: has {len(stamps)} times for {len(images)} images in {folder}; check the download"
        )
    frames = tuple(Frame(number, path, stamps[number]) for number, path in enumerate(images))
    check_unique(frames, times)
    return frames


def _read_ground_truth(
    frames: tuple[Frame, ...], path: Path, calibration: Path, folder: str
) -> tuple[Trajectory | None, Notes]:
    """Return the poses of the camera; those of camera 0 are in the file."""
    try:
        projection = _read_projection(calibration, _IMAGE_FOLDERS[folder])
    except SequenceError:
        if folder != "image_0":
            return None, (f"{path.name} has poses of camera 0, but no calib.txt moves them to {folder}: left out",)
        projection = np.eye(3, 4)
    with naming(path):
        poses = _moved_to_camera(read_trajectory(path, format="kitti"), projection)
    return poses_by_line(frames, poses, path)


def _read_projection(path: Path, name: str) -> NDArray[np.float64]:
    """Return the 3x4 projection matrix of a rectified camera."""
    if not path.is_file():
        raise SequenceError(f"{path}: expected the calibration, found no such file; {GIVE_THE_CAMERA}")
    for line, fields in read_rows(path):
        if fields[0].rstrip(":") == name and len(fields) == 13:
            matrix = np.array(to_numbers(fields[1:], path, line)).reshape(3, 4)
            with naming(path):
                check_calibration_matrix(matrix[:, :3])
                check_near(matrix[:, 3], path)
            return matrix
    raise SequenceError(f"{path}: expected a line '{name}:' with 12 numbers, found none; {GIVE_THE_CAMERA}")


def _unread_lines(path: Path) -> Notes:
    others = [fields[0].rstrip(":") for _, fields in read_rows(path) if fields[0].rstrip(":") not in _KNOWN_LINES]
    return (f"{path.name} has lines that are not read: {', '.join(others)}",) if others else ()


def _moved_to_camera(poses: Trajectory, projection: NDArray[np.float64]) -> Trajectory:
    """Turn poses of camera 0 into those of the projection K [I | K^-1 p], which stands beside it."""
    centre = -np.linalg.solve(projection[:, :3], projection[:, 3])
    return replace(poses, positions=poses.positions + poses.rotations.as_matrix() @ centre)


KITTI = Layout(
    name="kitti",
    matches=_matches,
    read=_read,
    help=(
        "KITTI odometry (https://www.cvlibs.net/datasets/kitti/eval_odometry.php): unpack grey images, calibration and "
        "poses into one folder and give dataset/sequences/07, which holds image_0/, times.txt and calib.txt; poses are "
        "found in dataset/poses/07.txt."
    ),
)
