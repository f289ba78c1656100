"""Read a plain folder of images."""

from collections.abc import Iterable
from pathlib import Path

from natsort import natsorted

from gtf_tune.errors import SequenceError
from gtf_tune.sequence.images import IMAGE_KINDS, is_image
from gtf_tune.sequence.layouts.base import Layout, Recording
from gtf_tune.sequence.value import Frame

_UNREAD_SUFFIXES = frozenset({".avif", ".heic", ".heif", ".jxl", ".webp"})


def list_images(folder: Path, pattern: str = "*") -> tuple[Path, ...]:
    """Return the images of a folder in natural order (frame2 before frame10), or raise `SequenceError` if none."""
    try:
        found = [path for path in folder.glob(pattern) if is_image(path)]
    except OSError as error:
        raise SequenceError(f"{folder}: cannot list the folder ({error.strerror}); check its permissions") from error
    if not found:
        raise SequenceError(f"{folder}: found no images '{pattern}' ({IMAGE_KINDS}); give the folder that holds them")
    return tuple(natsorted(found, key=lambda path: path.name))


def counted_frames(paths: Iterable[Path], rate_hz: float = 1.0) -> tuple[Frame, ...]:
    """Return frames whose timestamps count from 0 at a rate."""
    return tuple(Frame(number, path, number / rate_hz) for number, path in enumerate(paths))


def _matches(root: Path) -> bool:
    return root.is_dir() and any(is_image(path) for path in root.iterdir())


def _read(root: Path) -> Recording:
    images = list_images(root)
    return Recording(
        counted_frames(images), has_timestamps=False, notes=_left_out(root, {path.stem for path in images})
    )


def _left_out(root: Path, read: set[str]) -> tuple[str, ...]:
    """Say which photographs of the folder are in no format that is read, but for those that are there in one too."""
    others = [path for path in root.iterdir() if path.suffix.lower() in _UNREAD_SUFFIXES and path.stem not in read]
    if not others:
        return ()
    kinds = ", ".join(sorted({path.suffix.lower()[1:] for path in others}))
    return (f"photographs that are left out because their format is not read: {len(others)} ({kinds}); convert them",)


FOLDER = Layout(
    name="folder",
    matches=_matches,
    read=_read,
    help="Any folder of images of one camera, in the natural order of their names. No timestamps, no ground truth.",
)
