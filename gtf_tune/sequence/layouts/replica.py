"""Read the Replica sequences that iMAP rendered and NICE-SLAM distributes."""

import json
from pathlib import Path

from gtf_tune.errors import SequenceError
from gtf_tune.sequence.camera import Camera, pinhole_from_opencv
from gtf_tune.sequence.layouts.base import Layout, Recording
from gtf_tune.sequence.layouts.folder import counted_frames, list_images
from gtf_tune.sequence.layouts.ground_truth import poses_from_matrices
from gtf_tune.sequence.layouts.tables import read_numbers, read_text

_RATE_HZ = 30.0


def _matches(root: Path) -> bool:
    return (root / "traj.txt").is_file() and (root / "results").is_dir()


def _read(root: Path) -> Recording:
    frames = counted_frames(list_images(root / "results", "frame*"), _RATE_HZ)
    path = root / "traj.txt"
    numbers = read_numbers(path)
    if len(numbers) != 16 * len(frames):
        raise SequenceError(
            f"{path}: expected 16 numbers for each of {len(frames)} images, found {len(numbers)}; check the download"
        )
    poses = poses_from_matrices(frames, numbers.reshape(-1, 4, 4), path)
    notes = (f"{root.name} has no timestamps; they are counted at {_RATE_HZ:g} Hz",)
    return Recording(frames, _read_camera(root), poses, notes=notes)


def _read_camera(root: Path) -> Camera | None:
    """Read cam_params.json beside the sequence or its folder."""
    for folder in (root, root.parent):
        path = folder / "cam_params.json"
        if path.is_file():
            try:
                values = json.loads(read_text(path))["camera"]
                numbers = [float(values[name]) for name in ("fx", "fy", "cx", "cy")]
                size = int(values["w"]), int(values["h"])
            except (json.JSONDecodeError, KeyError, TypeError, ValueError) as error:
                raise SequenceError(f"{path}: expected a 'camera' with w, h, fx, fy, cx, cy; mend the file") from error
            return pinhole_from_opencv((numbers[0], numbers[1]), (numbers[2], numbers[3]), size)
    return None


REPLICA = Layout(
    name="replica",
    matches=_matches,
    read=_read,
    help=(
        "Replica as rendered for iMAP (Replica.zip of https://github.com/cvg/nice-slam): give a scene's folder, which "
        "holds results/frame*.jpg and traj.txt; intrinsics come from cam_params.json beside the scenes."
    ),
)
