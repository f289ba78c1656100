"""Read the Replica sequences that iMAP rendered and NICE-SLAM distributes."""

from pathlib import Path

from gtf_tune.errors import SequenceError
from gtf_tune.sequence.camera import pinhole_from_opencv
from gtf_tune.sequence.layouts.base import UNKNOWN, Intrinsics, Layout, Reading, Recording, naming, one_camera
from gtf_tune.sequence.layouts.fields import read_json
from gtf_tune.sequence.layouts.folder import counted_frames, list_images
from gtf_tune.sequence.layouts.ground_truth import poses_from_matrices
from gtf_tune.sequence.layouts.tables import read_numbers

_RATE_HZ = 30.0

# The scale is that of depth images.
_CAMERA_KEYS = frozenset({"w", "h", "fx", "fy", "cx", "cy", "scale"})


def _matches(root: Path) -> bool:
    return (root / "traj.txt").is_file() and (root / "results").is_dir()


def _read(root: Path, _: Reading) -> Recording:
    frames = counted_frames(list_images(root / "results", "frame*"), _RATE_HZ)
    path = root / "traj.txt"
    numbers = read_numbers(path)
    if len(numbers) != 16 * len(frames):
        raise SequenceError(
            f"{path}: expected 16 numbers for each of {len(frames)} images, found {len(numbers)}; check the download"
        )
    poses = poses_from_matrices(frames, numbers.reshape(-1, 4, 4), path)
    notes = (f"{root.name} has no timestamps; they are counted at {_RATE_HZ:g} Hz",)
    calibration = _calibration(root)
    files = (path, *((calibration,) if calibration else ()))
    return Recording(frames, lambda: _read_intrinsics(calibration), poses, notes=notes, files=files)


def _calibration(root: Path) -> Path | None:
    """Return cam_params.json beside the sequence or its folder."""
    paths = (folder / "cam_params.json" for folder in (root, root.parent))
    return next((path for path in paths if path.is_file()), None)


def _read_intrinsics(path: Path | None) -> Intrinsics:
    if path is None:
        return UNKNOWN
    values = read_json(path)["camera"]
    fx, fy, cx, cy = (values[name].number() for name in ("fx", "fy", "cx", "cy"))
    others = values.others(_CAMERA_KEYS)
    notes = (f"{path.name} has keys that are not read: {', '.join(others)}",) if others else ()
    with naming(path):
        return one_camera(pinhole_from_opencv((fx, fy), (cx, cy), (values["w"].count(), values["h"].count())), *notes)


REPLICA = Layout(
    name="replica",
    matches=_matches,
    read=_read,
    help=(
        "Replica as rendered for iMAP (Replica.zip of https://github.com/cvg/nice-slam): give a scene's folder, which "
        "holds results/frame*.jpg and traj.txt; intrinsics come from cam_params.json beside the scenes."
    ),
)
