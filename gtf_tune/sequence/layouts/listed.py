"""Find the images that lists and models name, also where the names come from another machine."""

from pathlib import Path, PurePosixPath, PureWindowsPath

from gtf_tune.errors import SequenceError
from gtf_tune.sequence.image_formats import IMAGE_SUFFIXES, is_image
from gtf_tune.sequence.layouts.tables import shortened

_LONGEST_NAME = 4096


def find_listed(folder: Path, name: str, source: Path) -> Path:
    """Return the image that ``source`` calls ``name`` relative to ``folder``, whether it is there or not.

    Where there is no such file, backslashes may separate folders, and an absolute path of another machine is looked
    for by as many of its last parts as lie below ``folder``.

    Raises
    ------
    SequenceError
        The name is none that a file can have.
    """
    if not name.strip() or "\0" in name or len(name) > _LONGEST_NAME:
        raise SequenceError(f"{source}: expected the name of an image, found '{shortened(name)}'; check the file")
    exact = folder / name
    if _is_file(exact):
        return exact
    parts = PureWindowsPath(name).parts if "\\" in name else PurePosixPath(name).parts
    relative = [part for part in parts if part != PureWindowsPath(name).anchor and part != "/"]
    if exact.is_dir():
        raise SequenceError(f"{source}: expected the name of an image, found that of a folder; check the file")
    tails = (folder.joinpath(*relative[start:]) for start in range(len(relative)))
    return next((path for path in tails if _is_file(path)), exact)


def with_suffix(path: Path) -> Path:
    """Return the image that a name without its suffix means; NeRF's own scenes leave it out."""
    if is_image(path) and (_is_file(path) or not _is_file(_png(path))):
        return path
    candidates = (path.with_name(f"{path.name}{suffix}") for suffix in sorted(IMAGE_SUFFIXES))
    return next((candidate for candidate in candidates if _is_file(candidate)), _png(path))


def _png(path: Path) -> Path:
    return path.with_name(f"{path.name}.png")


def _is_file(path: Path) -> bool:
    try:
        return path.is_file()
    except (OSError, ValueError):
        return False
