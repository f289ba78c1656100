"""Find the layout of a data set."""

from contextlib import suppress
from pathlib import Path

from gtf_tune.errors import SequenceError, did_you_mean
from gtf_tune.sequence.image_formats import IMAGE_KINDS
from gtf_tune.sequence.layouts.base import Layout
from gtf_tune.sequence.layouts.colmap import COLMAP
from gtf_tune.sequence.layouts.euroc import EUROC
from gtf_tune.sequence.layouts.folder import FOLDER, images_below, named_folders, unread_photographs
from gtf_tune.sequence.layouts.icl_nuim import ICL_NUIM
from gtf_tune.sequence.layouts.kitti import KITTI
from gtf_tune.sequence.layouts.nerf import NERF
from gtf_tune.sequence.layouts.numbered import SCANNET, SEVEN_SCENES
from gtf_tune.sequence.layouts.replica import REPLICA
from gtf_tune.sequence.layouts.strecha import STRECHA
from gtf_tune.sequence.layouts.tartanair import TARTANAIR
from gtf_tune.sequence.layouts.tum import ETH3D_SLAM, TUM_RGBD
from gtf_tune.sequence.layouts.vslam_lab import VSLAM_LAB

AUTO = "auto"

_VIDEO_SUFFIXES = frozenset({".avi", ".m4v", ".mkv", ".mov", ".mp4", ".mpg", ".webm"})

# The first that matches wins, so a layout stands before those whose marks it shares.
_LAYOUTS: tuple[Layout, ...] = (
    VSLAM_LAB,
    ICL_NUIM,
    ETH3D_SLAM,
    TUM_RGBD,
    KITTI,
    EUROC,
    REPLICA,
    TARTANAIR,
    SCANNET,
    SEVEN_SCENES,
    COLMAP,
    NERF,
    STRECHA,
    FOLDER,
)


# Those that a file above the images gives away; EuRoC's is three folders above.
_ABOVE = (VSLAM_LAB, ETH3D_SLAM, TUM_RGBD, KITTI, REPLICA, TARTANAIR, SCANNET, COLMAP, NERF)
_EUROC_DEPTH = 3


def layout_names() -> tuple[str, ...]:
    """Return the names of all layouts, in the order in which they are tried."""
    return tuple(layout.name for layout in _LAYOUTS)


def layout_help() -> dict[str, str]:
    """Return for each layout what to download and which path to give."""
    return {layout.name: layout.help for layout in _LAYOUTS}


def find_layout(root: Path, name: str = AUTO, *, recursive: bool = False) -> Layout:
    """Return the layout of this name, or with "auto" the first that fits the folder.

    With ``recursive`` that is a plain folder, the only layout whose subfolders mean nothing.

    Raises
    ------
    SequenceError
        There is no layout of this name, or none fits.
    """
    if recursive:
        if name not in (AUTO, FOLDER.name):
            raise SequenceError(f"recursive is for layout '{FOLDER.name}', not '{name}'; leave one of them out")
        return FOLDER
    if name != AUTO:
        return _named(name)
    try:
        found = next((layout for layout in _LAYOUTS if layout.matches(root)), None)
    except OSError as error:
        raise SequenceError(f"{root}: cannot look into the folder ({error.strerror}); check its permissions") from error
    if found is None:
        raise _unknown(root)
    return found


def _unknown(root: Path) -> SequenceError:
    """Return the error that a path is no data set, with what to give instead."""
    if root.suffix.lower() in _VIDEO_SUFFIXES:
        return SequenceError(
            f"{root}: this is a video; take its frames out first, and give their folder",
            remedy=("extract", root.name, f"{root.stem}/"),
        )
    below = images_below(root) if root.is_dir() else {}
    if below:
        return SequenceError(
            f"{root}: found no images here, but in subfolders: {named_folders(below)}; give one of them, or all "
            "as one sequence with recursive = true",
            remedy=("recursive",),
        )
    unread = unread_photographs(root) if root.is_dir() else ""
    if unread:
        return SequenceError(
            f"{root}: found photographs, but in formats that are not read: {unread}; develop or convert them to JPEG, "
            "PNG or TIFF"
        )
    above = layout_above(root)
    if above:
        return SequenceError(f"{root}: found no images; {above[1]} looks like layout '{above[0]}': give that folder")
    if root.is_file():
        return SequenceError(f"{root}: expected a folder of images, found a file; unpack archives, and give the folder")
    return SequenceError(
        f"{root}: found neither images ({IMAGE_KINDS}) nor a known layout ({', '.join(layout_names())}); give the "
        "folder that holds the images, and take frames out of a video first",
        remedy=("extract", "VIDEO", "FOLDER"),
    )


def layout_above(root: Path) -> tuple[str, Path] | None:
    """Return layout and folder of the data set that a plain folder of images seems to be a part of."""
    places = [(layout, root.parent) for layout in _ABOVE]
    places += [(EUROC, folder) for folder in root.parents[_EUROC_DEPTH - 1 : _EUROC_DEPTH]]
    for layout, folder in places:
        with suppress(OSError):
            if layout.matches(folder):
                return layout.name, folder
    return None


def _named(name: str) -> Layout:
    for layout in _LAYOUTS:
        if layout.name == name:
            return layout
    hint = did_you_mean(name, layout_names())
    raise SequenceError(f"unknown layout '{name}'; {hint and f'{hint} '}The layouts are {', '.join(layout_names())}")
