"""Read the layout of the TUM RGB-D benchmark, which ETH3D SLAM extends by a calibration file."""

from pathlib import Path

from gtf_tune.errors import SequenceError
from gtf_tune.sequence.camera import Camera, pinhole_from_opencv
from gtf_tune.sequence.images import image_size
from gtf_tune.sequence.layouts.base import Layout, Recording, check_unique
from gtf_tune.sequence.layouts.ground_truth import poses_by_timestamp
from gtf_tune.sequence.layouts.tables import read_numbers, read_rows, to_numbers
from gtf_tune.sequence.value import Frame
from gtf_tune.trajectory import Trajectory, read_trajectory


def read_image_list(path: Path) -> tuple[Frame, ...]:
    """Return the frames of a file of lines ``timestamp image``, whose images are relative to the file's folder."""
    frames: list[Frame] = []
    for line, fields in read_rows(path):
        if len(fields) != 2:
            raise SequenceError(f"{path}:{line}: expected 'timestamp image', found '{' '.join(fields)}'; mend the line")
        frames.append(Frame(len(frames), path.parent / fields[1], to_numbers(fields[:1], path, line)[0]))
    if not frames:
        raise SequenceError(f"{path}: lists no images; give a sequence that has some")
    check_unique(tuple(frames), path)
    return tuple(frames)


def _read_calibration(path: Path, image: Path) -> Camera:
    numbers = read_numbers(path)
    if len(numbers) != 4:
        raise SequenceError(f"{path}: expected 'fx fy cx cy', found {len(numbers)} numbers; mend the file")
    fx, fy, cx, cy = (float(number) for number in numbers)
    return pinhole_from_opencv((fx, fy), (cx, cy), image_size(image))


def _read(root: Path) -> Recording:
    frames = read_image_list(root / "rgb.txt")
    calibration, poses = root / "calibration.txt", root / "groundtruth.txt"
    ground_truth: Trajectory | None = None
    notes: tuple[str, ...] = ()
    if poses.exists():
        ground_truth, notes = poses_by_timestamp(frames, read_trajectory(poses, format="tum"), poses)
    camera = _read_calibration(calibration, frames[0].path) if calibration.exists() else None
    return Recording(frames, camera, ground_truth, notes=notes)


ETH3D_SLAM = Layout(
    name="eth3d-slam",
    matches=lambda root: (root / "rgb.txt").is_file() and (root / "calibration.txt").is_file(),
    read=_read,
    help=(
        "ETH3D SLAM (https://www.eth3d.net/slam_datasets): unpack the mono or rgbd archive of a training sequence and "
        "give its folder, which holds rgb.txt, rgb/, calibration.txt and groundtruth.txt."
    ),
)

TUM_RGBD = Layout(
    name="tum-rgbd",
    matches=lambda root: (root / "rgb.txt").is_file(),
    read=_read,
    help=(
        "TUM RGB-D (https://cvg.cit.tum.de/data/datasets/rgbd-dataset/download): unpack a sequence's .tgz and give its "
        "folder, which holds rgb.txt, rgb/ and groundtruth.txt. It has no intrinsics: write 'fx fy cx cy' into "
        "calibration.txt if images are undistorted, or give the camera."
    ),
)
