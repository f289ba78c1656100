"""Read TartanAir (version 1): poses in north-east-down axes, no timestamps."""

from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from gtf_tune.errors import SequenceError
from gtf_tune.sequence.camera import Camera
from gtf_tune.sequence.layouts.base import Layout, Reading, Recording, one_camera
from gtf_tune.sequence.layouts.folder import counted_frames, list_images
from gtf_tune.sequence.layouts.ground_truth import poses_from_matrices
from gtf_tune.sequence.layouts.tables import read_rows, to_numbers
from gtf_tune.trajectory.formats import UNIT_TOLERANCE

# Rendered with a field of view of exactly 90 degrees, so the principal point is the centre of the image: 320, 240 with
# pixel centres at +0.5.
_CAMERA = Camera("PINHOLE", 640, 480, (320.0, 320.0, 320.0, 240.0))

# Columns: the axes of an OpenCV camera (right, down, forward) in those of an NED one (forward, right, down).
_NED_FROM_OPENCV = np.array([[0.0, 0, 1], [1, 0, 0], [0, 1, 0]])


def _files(root: Path) -> tuple[Path, Path]:
    """Return the folder of images and the file of poses: those of a trajectory, or of the monocular test track."""
    of_the_test_track = root.parent.with_name("mono_gt") / f"{root.name}.txt"
    return (root, of_the_test_track) if of_the_test_track.is_file() else (root / "image_left", root / "pose_left.txt")


def _matches(root: Path) -> bool:
    images, poses = _files(root)
    return images.is_dir() and poses.is_file()


def _read(root: Path, _: Reading) -> Recording:
    images, path = _files(root)
    frames = counted_frames(list_images(images))
    rows = np.array([to_numbers(fields, path, line) for line, fields in _pose_rows(path)]).reshape(-1, 7)
    if len(rows) != len(frames):
        raise SequenceError(
            f"{path}: expected {len(frames)} poses, one for each image, found {len(rows)}; check the download"
        )
    _check_quaternions(rows[:, 3:], path)
    matrices = np.tile(np.eye(4), (len(rows), 1, 1))
    matrices[:, :3, :3] = Rotation.from_quat(rows[:, 3:]).as_matrix() @ _NED_FROM_OPENCV
    matrices[:, :3, 3] = rows[:, :3]
    ground_truth = poses_from_matrices(frames, matrices, path)
    return Recording(frames, lambda: one_camera(_CAMERA), ground_truth, has_timestamps=False, files=(path,))


def _check_quaternions(quaternions: NDArray[np.float64], path: Path) -> None:
    wrong = np.abs(np.sqrt(np.square(np.clip(quaternions, -2, 2)).sum(axis=1)) - 1) > UNIT_TOLERANCE
    if wrong.any():
        raise SequenceError(
            f"{path}: expected unit quaternions qx qy qz qw, found another in pose {int(np.argmax(wrong)) + 1}; check "
            "the file"
        )


def _pose_rows(path: Path) -> list[tuple[int, list[str]]]:
    rows = read_rows(path)
    for line, fields in rows:
        if len(fields) != 7:
            raise SequenceError(
                f"{path}:{line}: expected 'tx ty tz qx qy qz qw', found {len(fields)} fields; correct the line"
            )
    return rows


TARTANAIR = Layout(
    name="tartanair",
    matches=_matches,
    read=_read,
    help=(
        "TartanAir v1 (https://github.com/castacks/tartanair_tools): download image_left of an environment and give "
        "one trajectory's folder, such as office/Easy/P000, which holds image_left/ and pose_left.txt; or unpack the "
        "monocular test track and give mono/ME001, whose poses are found in mono_gt/ME001.txt."
    ),
)
