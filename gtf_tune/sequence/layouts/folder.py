"""Read a plain folder of images."""

from collections.abc import Iterable
from pathlib import Path

from natsort import natsorted

from gtf_tune.errors import SequenceError
from gtf_tune.sequence.images import IMAGE_SUFFIXES, is_image
from gtf_tune.sequence.layouts.base import Layout, Recording
from gtf_tune.sequence.value import Frame


def list_images(folder: Path, pattern: str = "*") -> tuple[Path, ...]:
    """Return the images of a folder in natural order (frame2 before frame10), or raise `SequenceError` if none."""
    try:
        found = [path for path in folder.glob(pattern) if is_image(path)]
    except OSError as error:
        raise SequenceError(f"{folder}: cannot list the folder ({error.strerror}); check its permissions") from error
    if not found:
        kinds = ", ".join(sorted(suffix[1:] for suffix in IMAGE_SUFFIXES))
        raise SequenceError(f"{folder}: found no images '{pattern}' ({kinds}); give the folder that holds them")
    return tuple(natsorted(found, key=lambda path: path.name))


def counted_frames(paths: Iterable[Path], rate_hz: float = 1.0) -> tuple[Frame, ...]:
    """Return frames whose timestamps count from 0 at a rate."""
    return tuple(Frame(number, path, number / rate_hz) for number, path in enumerate(paths))


def _matches(root: Path) -> bool:
    return root.is_dir() and any(is_image(path) for path in root.iterdir())


def _read(root: Path) -> Recording:
    return Recording(counted_frames(list_images(root)), has_timestamps=False)


FOLDER = Layout(
    name="folder",
    matches=_matches,
    read=_read,
    help="Any folder of images of one camera, in the natural order of their names. No timestamps, no ground truth.",
)
