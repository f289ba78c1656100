"""Read ICL-NUIM, as TUM-compatible PNGs or as the renderer's own."""

import re
from dataclasses import replace
from pathlib import Path

from gtf_tune.errors import SequenceError
from gtf_tune.sequence.camera import pinhole_from_opencv
from gtf_tune.sequence.layouts.base import Layout, Reading, Recording, check_unique, naming, one_camera
from gtf_tune.sequence.layouts.folder import list_images
from gtf_tune.sequence.layouts.ground_truth import Notes, mirrored, poses_by_timestamp
from gtf_tune.sequence.layouts.tables import find_listed, read_rows, shortened
from gtf_tune.sequence.value import Frame
from gtf_tune.trajectory import Trajectory, read_trajectory

_RATE_HZ = 30.0
_LONGEST_NUMBER = 12

# Published as fy = -480: the renderer's world and cameras have y pointing up, which makes them left-handed.
_CAMERA = pinhole_from_opencv((481.2, 480.0), (319.5, 239.5), (640, 480))


def _pose_file(root: Path) -> Path | None:
    return next(iter(sorted(root.glob("*.gt.freiburg"))), None) if root.is_dir() else None


def _read(root: Path, _: Reading) -> Recording:
    images = sorted(_numbered(root).items())
    frames = tuple(Frame(position, path, number / _RATE_HZ) for position, (number, path) in enumerate(images))
    check_unique(frames, root)
    poses = _pose_file(root)
    ground_truth: Trajectory | None = None
    notes: Notes = ()
    if poses is not None:
        with naming(poses):
            published = read_trajectory(poses, format="tum")
        timed = replace(published, timestamps=published.timestamps / _RATE_HZ)
        ground_truth, notes = poses_by_timestamp(frames, mirrored(timed), poses)
    files = (root / "associations.txt", *((poses,) if poses else ()))
    return Recording(frames, lambda: one_camera(_CAMERA), ground_truth, notes=notes, files=files)


def _numbered(root: Path) -> dict[int, Path]:
    """Return the images by the numbers under which the pose file counts them."""
    pairs = root / "associations.txt"
    if pairs.is_file():
        return dict(_association(root, pairs, line, fields) for line, fields in read_rows(pairs))
    folder, pattern = (root / "rgb", "*") if (root / "rgb").is_dir() else (root, "scene_*")
    found = {path: re.search(r"([0-9]+)$", path.stem) for path in list_images(folder, pattern)}
    unnumbered = next((path for path, match in found.items() if match is None), None)
    if unnumbered:
        raise SequenceError(f"{unnumbered}: expected an image name that ends in a number; rename or remove the file")
    return {int(match.group(1)): path for path, match in found.items() if match}


def _association(root: Path, pairs: Path, line: int, fields: list[str]) -> tuple[int, Path]:
    """Return number and colour image of a line ``number depth number rgb``."""
    if len(fields) != 4 or not _is_frame_number(fields[2]):
        raise SequenceError(
            f"{pairs}:{line}: expected 'number depth-image number colour-image', found "
            f"'{shortened(' '.join(fields))}'; correct the line"
        )
    return int(fields[2]), find_listed(root, fields[3], pairs)


def _is_frame_number(text: str) -> bool:
    return text.isascii() and text.isdecimal() and len(text) <= _LONGEST_NUMBER


ICL_NUIM = Layout(
    name="icl-nuim",
    matches=lambda root: _pose_file(root) is not None,
    read=_read,
    help=(
        "ICL-NUIM (https://www.doc.ic.ac.uk/~ahanda/VaFRIC/iclnuim.html): unpack a sequence, as TUM-compatible PNGs or "
        "as the native ones, put its *.gt.freiburg pose file beside rgb/ (or scene_00_*.png), and give that folder."
    ),
)
