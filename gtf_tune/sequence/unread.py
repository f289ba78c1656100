"""Find files beside the images that bear on camera or poses and were not read."""

import os
import re
from collections.abc import Collection, Iterator
from pathlib import Path

from gtf_tune.sequence.layouts.base import Notes

_SUFFIXES = frozenset(
    [
        ".txt",
        ".csv",
        ".tsv",
        ".dat",
        ".yaml",
        ".yml",
        ".json",
        ".xml",
        ".toml",
        ".ini",
        ".cfg",
        ".conf",
        ".npy",
        ".npz",
        ".mat",
        ".camera",
        ".cam",
        ".calib",
        ".db",
        ".bin",
        ".pkl",
        ".freiburg",
        ".log",
        ".tum",
        ".kitti",
        ".bag",
        ".db3",
        ".mcap",
    ]
)
_BEARING = re.compile(
    r"calib|camera|(^|[_.-])cams?([_.0-9-]|$)|intrin|extrin|distort|fisheye|sensor|pose|traj|odom|ground.?truth|"
    r"(^|[_.-])gt([_.-]|$)|mocap|vicon|leica|transform|camchain|(^|[_.-])rigs?[_.-]|times?(tamps?)?([_.-]|$)|"
    r"^k\.txt$|^database\.db$|^images\.(txt|bin)$",
    re.IGNORECASE,
)
# Known parts of data sets that say nothing of a single camera's images.
_HARMLESS = re.compile(
    r"depth|imu|(^|[_.-])right|[_.-]right|readme|requirements|license|accelero|gyro|(^|[_.-])cam[1-9]", re.IGNORECASE
)
_NAMED = 6
_DEPTH = 2
_MOST_FOLDERS = 50


def unread_files(root: Path, read: Collection[Path]) -> Notes:
    """Return a note on files below ``root`` that may describe camera or poses and are not among those read.

    Names decide: nothing is opened, and folders below the second level are not looked into.
    """
    known = {path.absolute() for path in read}
    found = [path for path in _files(root) if path.absolute() not in known and _bears(path)]
    if not found:
        return ()
    names = [str(path.relative_to(root)) for path in sorted(found)]
    more = f" and {len(names) - _NAMED} more" if len(names) > _NAMED else ""
    return (f"files that may describe camera or poses and are not read: {', '.join(names[:_NAMED])}{more}",)


def _bears(path: Path) -> bool:
    # The folder says what data.csv and sensor.yaml of EuRoC are.
    name = f"{path.parent.name}_{path.name}" if path.stem in ("data", "sensor") else path.name
    return path.suffix.lower() in _SUFFIXES and bool(_BEARING.search(name)) and not _HARMLESS.search(name)


def _files(root: Path) -> Iterator[Path]:
    folder = root if root.is_dir() else root.parent
    for number, (name, folders, files) in enumerate(os.walk(folder)):
        depth = len(Path(name).relative_to(folder).parts)
        folders[:] = sorted(inner for inner in folders if not inner.startswith(".")) if depth < _DEPTH else []
        if number >= _MOST_FOLDERS:
            return
        yield from (Path(name, file) for file in files if not file.startswith("."))
