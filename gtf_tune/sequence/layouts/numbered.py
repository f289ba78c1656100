"""Read data sets with one pose file beside each image: 7-Scenes and ScanNet."""

import re
from pathlib import Path

import numpy as np

from gtf_tune.errors import SequenceError
from gtf_tune.sequence.camera import Camera, pinhole_from_matrix
from gtf_tune.sequence.images import image_size
from gtf_tune.sequence.layouts.base import Intrinsics, Layout, Reading, Recording, naming, one_camera
from gtf_tune.sequence.layouts.folder import list_images
from gtf_tune.sequence.layouts.ground_truth import poses_from_matrices
from gtf_tune.sequence.layouts.tables import read_matrix
from gtf_tune.sequence.value import Frame
from gtf_tune.trajectory import Trajectory

_RATE_HZ = 30.0
_NUMBER = re.compile(r"[0-9]{1,18}")

# 7-Scenes has a calibration of the depth camera only, of 585 pixels; 525 is nominal for the Kinect's colour camera.
_KINECT_FOCAL, _KINECT_WIDTH = 525.0, 640
_KINECT = "7-Scenes describes its depth camera only: poses are those of it, and colour images start from 525 pixels"


def _read_seven_scenes(root: Path, _: Reading) -> Recording:
    frames = _numbered_frames(root, "frame-*.color.*")
    poses = tuple(root / f"{frame.path.name.split('.')[0]}.pose.txt" for frame in frames)

    def read_intrinsics() -> Intrinsics:
        width, _ = image_size(frames[0].path)
        return Intrinsics(notes=(_KINECT,), focal_priors=(_KINECT_FOCAL * width / _KINECT_WIDTH,))

    return Recording(frames, read_intrinsics, _read_poses(frames, poses), files=poses)


def _read_scannet(root: Path, _: Reading) -> Recording:
    frames = _numbered_frames(root / "color", "*")
    poses = _pose_files(root / "pose", frames)
    ground_truth = _read_poses(frames, poses) if (root / "pose").is_dir() else None
    lost = ground_truth is None and any((root / "pose").glob("*.txt"))
    calibration = root / "intrinsic" / "intrinsic_color.txt"

    def read_intrinsics() -> Intrinsics:
        return one_camera(_scannet_camera(calibration, frames[0].path))

    notes = ("pose/ has poses, but none that is called like an image and finite",) if lost else ()
    return Recording(frames, read_intrinsics, ground_truth, notes=notes, files=(calibration, *poses))


def _pose_files(folder: Path, frames: tuple[Frame, ...]) -> tuple[Path, ...]:
    """Return the pose file of each image, of its name or of its number: 20.txt suits 000020.jpg."""
    numbered = {int(path.stem): path for path in folder.glob("*.txt") if _NUMBER.fullmatch(path.stem)}
    return tuple(
        numbered.get(int(frame.path.stem), folder / f"{frame.path.stem}.txt")
        if _NUMBER.fullmatch(frame.path.stem)
        else folder / f"{frame.path.stem}.txt"
        for frame in frames
    )


def _scannet_camera(path: Path, image: Path) -> Camera | None:
    if not path.is_file():
        return None
    matrix, size = read_matrix(path, 3, 4), image_size(image)
    with naming(path):
        return pinhole_from_matrix(matrix, size)


def _numbered_frames(folder: Path, pattern: str) -> tuple[Frame, ...]:
    """Return frames whose timestamps count the numbers in the file names at 30 Hz: left-out frames leave gaps."""
    frames: list[Frame] = []
    for path in list_images(folder, pattern):
        number = re.search(r"[0-9]+", path.name)
        if number is None:
            raise SequenceError(f"{path}: expected a number in the name of the image; rename or remove the file")
        frames.append(Frame(len(frames), path, int(number.group()) / _RATE_HZ))
    return tuple(frames)


def _read_poses(frames: tuple[Frame, ...], paths: tuple[Path, ...]) -> Trajectory | None:
    """Return the ground truth of one 4x4 matrix per file; missing files and infinite matrices (lost track) are gaps."""
    gap = np.full((4, 4), np.nan)
    matrices = [read_matrix(path, 4, 4) if path.is_file() else gap for path in paths]
    return poses_from_matrices(frames, np.stack(matrices), paths[0].parent)


SEVEN_SCENES = Layout(
    name="7-scenes",
    matches=lambda root: any(root.glob("frame-*.color.*")),
    read=_read_seven_scenes,
    help=(
        "7-Scenes (https://www.microsoft.com/en-us/research/project/rgb-d-dataset-7-scenes): unpack a scene and one of "
        "its sequences and give that folder, such as chess/seq-01, which holds frame-*.color.png and frame-*.pose.txt."
    ),
)

SCANNET = Layout(
    name="scannet",
    matches=lambda root: (root / "color").is_dir() and ((root / "pose").is_dir() or (root / "intrinsic").is_dir()),
    read=_read_scannet,
    help=(
        "ScanNet (http://www.scan-net.org): export a .sens file with SensReader (colour images, poses, intrinsics) and "
        "give the export's folder, which holds color/, pose/ and intrinsic/."
    ),
)
