"""Read a plain folder of images, with its subfolders or without."""

import re
from collections import Counter
from collections.abc import Collection, Iterable, Iterator
from pathlib import Path

from natsort import natsorted

from gtf_tune.errors import SequenceError
from gtf_tune.sequence.image_formats import (
    CLASSIC_SUFFIXES,
    IMAGE_KINDS,
    IMAGE_SUFFIXES,
    LATER_SUFFIXES,
    UNREAD_SUFFIXES,
    is_image,
)
from gtf_tune.sequence.layouts.base import Layout, Notes, Reading, Recording
from gtf_tune.sequence.layouts.cameras.colmap_database import database_intrinsics, database_of
from gtf_tune.sequence.value import Frame

_NAMED_FOLDERS = 4
_MAP = re.compile(r"(^|[_.-])(depth|disp|disparity|masks?|normals?|seg|segmentation)([_.-]|$)", re.IGNORECASE)
_MOST_FOLDERS = 1000


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


def images_below(root: Path) -> dict[str, int]:
    """Return the number of images of each subfolder at any depth that holds some, in natural order.

    Hidden folders are left out, and no more than the first 1000 folders are looked into.
    """
    counts = Counter(folder for folder in _folders(root, recursive=True) for _ in _images_in(folder))
    names = {str(folder.relative_to(root)): count for folder, count in counts.items() if folder != root}
    return {name: names[name] for name in natsorted(names)}


def named_folders(counts: dict[str, int]) -> str:
    """Return the subfolders and their numbers of images in words."""
    named = [f"{name}/ ({count})" for name, count in list(counts.items())[:_NAMED_FOLDERS]]
    return ", ".join(named) + (f" and {len(counts) - len(named)} more" if len(counts) > len(named) else "")


def _matches(root: Path) -> bool:
    return root.is_dir() and any(is_image(path) for path in root.iterdir())


def _read(root: Path, reading: Reading) -> Recording:
    folders = list(_folders(root, reading.recursive))
    if len(folders) >= _MOST_FOLDERS:
        raise SequenceError(f"{root}: expected fewer than {_MOST_FOLDERS} folders of images; give one of them")
    found = [path for folder in folders for path in _images_in(folder) if path.suffix.lower() in reading.suffixes]
    images = natsorted(_without_doubles(found), key=lambda path: path.relative_to(root).as_posix())
    if not images:
        raise SequenceError(f"{root}: found no images ({IMAGE_KINDS}); give the folder that holds them")
    unread = unread_photographs(root, {path.stem for path in images}, reading.suffixes)
    notes = (
        [f"photographs that are left out because their format is not read: {unread}; convert them"] if unread else []
    )
    frames, database = counted_frames(images), database_of(root)
    return Recording(
        frames,
        lambda: database_intrinsics(database, frames),
        has_timestamps=False,
        notes=(*notes, *_below(root, reading)),
        files=(database,),
    )


def _without_doubles(images: list[Path]) -> list[Path]:
    """Leave out newer formats of photographs that are there in a classic one too, as phones and cameras write them."""
    classic = {path.with_suffix("") for path in images if path.suffix.lower() in CLASSIC_SUFFIXES}
    return [path for path in images if path.suffix.lower() in CLASSIC_SUFFIXES or path.with_suffix("") not in classic]


def _folders(root: Path, recursive: bool) -> Iterator[Path]:
    """Yield a folder, and with ``recursive`` up to 1000 folders below it that are not hidden."""
    waiting = [root]
    for _ in range(_MOST_FOLDERS):
        if not waiting:
            return
        folder = waiting.pop()
        yield folder
        if recursive:
            waiting += sorted(path for path in _entries(folder) if _is_shown_folder(path))


def _is_shown_folder(path: Path) -> bool:
    return not path.name.startswith((".", "@", "__")) and path.is_dir() and not path.is_symlink()


def _images_in(folder: Path) -> list[Path]:
    return [path for path in _entries(folder) if is_image(path)]


def _entries(folder: Path) -> list[Path]:
    try:
        return list(folder.iterdir())
    except OSError as error:
        raise SequenceError(f"{folder}: cannot list the folder ({error.strerror}); check its permissions") from error


def maps_among(frames: tuple[Frame, ...]) -> Notes:
    """Return a note on images that are called like depth maps or masks of others."""
    maps = [frame.path.name for frame in frames if _MAP.search(frame.path.stem)]
    if not 0 < len(maps) < len(frames):
        return ()
    return (f"{len(maps)} images are called like depth maps or masks, such as {maps[0]}: leave them out with exclude",)


def unread_photographs(folder: Path, read: Collection[str] = (), suffixes: Collection[str] = IMAGE_SUFFIXES) -> str:
    """Return number and formats of the photographs of a folder that are not read, "" where there are none.

    ``read`` are the stems of names that are there in a format among ``suffixes``, which is.
    """
    unread = UNREAD_SUFFIXES | (LATER_SUFFIXES - frozenset(suffixes))
    others = [path for path in _entries(folder) if path.suffix.lower() in unread and path.stem not in read]
    kinds = ", ".join(sorted({path.suffix.lower()[1:] for path in others}))
    return f"{len(others)} ({kinds})" if others else ""


def _below(root: Path, reading: Reading) -> Notes:
    counts = {} if reading.recursive else images_below(root)
    if not counts:
        return ()
    return (
        f"{sum(counts.values())} images in subfolders are left out: {named_folders(counts)}; "
        "recursive = true reads them",
    )


FOLDER = Layout(
    name="folder",
    matches=_matches,
    read=_read,
    help=(
        "Any folder of images of one or more cameras, in the natural order of their names; ``recursive`` takes those "
        "of its subfolders too. No timestamps, no ground truth."
    ),
)
