"""Read the layout of the TUM RGB-D benchmark, which ETH3D SLAM extends by a calibration file."""

from pathlib import Path

from gtf_tune.errors import SequenceError
from gtf_tune.sequence.camera import pinhole_from_opencv
from gtf_tune.sequence.images import image_size
from gtf_tune.sequence.layouts.base import (
    GIVE_THE_CAMERA,
    UNKNOWN,
    Intrinsics,
    Layout,
    Reading,
    Recording,
    naming,
    one_camera,
)
from gtf_tune.sequence.layouts.ground_truth import poses_by_timestamp
from gtf_tune.sequence.layouts.tables import read_image_list, read_numbers
from gtf_tune.trajectory import Trajectory, read_trajectory


def _read_intrinsics(path: Path, image: Path) -> Intrinsics:
    if not path.exists():
        return UNKNOWN
    numbers = read_numbers(path)
    if len(numbers) != 4:
        raise SequenceError(f"{path}: expected 'fx fy cx cy', found {len(numbers)} numbers; {GIVE_THE_CAMERA}")
    fx, fy, cx, cy = (float(number) for number in numbers)
    size = image_size(image)
    with naming(path):
        return one_camera(pinhole_from_opencv((fx, fy), (cx, cy), size))


def _read(root: Path, _: Reading) -> Recording:
    frames = read_image_list(root / "rgb.txt", root, "s")
    calibration, poses = root / "calibration.txt", root / "groundtruth.txt"
    ground_truth: Trajectory | None = None
    notes: tuple[str, ...] = ()
    if poses.is_file():
        with naming(poses):
            found = read_trajectory(poses, format="tum")
        ground_truth, notes = poses_by_timestamp(frames, found, poses)
    return Recording(
        frames,
        lambda: _read_intrinsics(calibration, frames[0].path),
        ground_truth,
        notes=notes,
        files=(root / "rgb.txt", calibration, poses),
    )


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
