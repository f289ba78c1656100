"""Read and write trajectory files in the formats that people exchange."""

import os
from collections.abc import Callable, Iterable, Mapping
from dataclasses import replace
from pathlib import Path
from types import MappingProxyType
from typing import Literal

import numpy as np

from gtf_tune.errors import TrajectoryError
from gtf_tune.trajectory.colmap import read_colmap
from gtf_tune.trajectory.columns import read_table
from gtf_tune.trajectory.formats import KITTI_COLUMNS, TextLayout, read_euroc, read_kitti, read_text, read_tum
from gtf_tune.trajectory.reconstructions import detected_kind, read_reconstruction
from gtf_tune.trajectory.value import Trajectory

TrajectoryFormat = Literal["auto", "tum", "kitti", "euroc", "colmap", "transforms", "opensfm", "sfmdata"]

_READERS: Mapping[str, Callable[[Path, TextLayout], Trajectory]] = MappingProxyType(
    {
        "tum": read_tum,
        "kitti": read_kitti,
        "euroc": read_euroc,
        "colmap": lambda path, _: read_colmap(path),
        "transforms": lambda path, _: read_reconstruction(path, "transforms"),
        "opensfm": lambda path, _: read_reconstruction(path, "opensfm"),
        "sfmdata": lambda path, _: read_reconstruction(path, "sfmdata"),
    }
)
_TUM_COLUMNS, _EUROC_COLUMNS = 8, 17


def read_trajectory(
    path: str | os.PathLike[str], format: TrajectoryFormat = "auto", delimiter: str | None = None
) -> Trajectory:
    """Read a trajectory from a TUM, KITTI or EuRoC file, a COLMAP model or a reconstruction in JSON.

    Frame ids count the poses from 0 and are marked so (``ids_are_counted``); for models whose images are called by
    numbers they are these numbers. Trajectories that lack different poses are associated by timestamp or image name.
    A header that names the columns of a TUM or EuRoC file decides on their order and on the unit of its timestamps.

    Parameters
    ----------
    path
        A file, or the folder of a COLMAP model.
    format
        ``auto`` takes folders, ``images.txt`` and ``.bin`` files for COLMAP's, and ``.json`` and ``.sfm`` files for
        reconstructions of nerfstudio (``transforms``), OpenSfM or AliceVision (``sfmdata``); columns show which of the
        others it is.
    delimiter
        What separates the columns of a line; semicolon, comma or blanks by what the first line has.

    Raises
    ------
    TrajectoryError
        The file cannot be read, is malformed (the message names the line), unsorted, or holds no poses; ``auto`` finds
        eight columns whose order nothing says.
    """
    file = Path(path)
    known = detected_format(file, delimiter) if format == "auto" else format
    if known not in _READERS:
        raise TrajectoryError(f"expected one of the formats auto, {', '.join(_READERS)}, not '{known}'")
    return replace(_READERS[known](file, TextLayout(delimiter)), source=str(path))


def detected_format(path: Path, delimiter: str | None = None) -> str:
    """Return the format that ``auto`` takes a file for.

    Raises
    ------
    TrajectoryError
        The file cannot be read, holds no poses, has columns of no known format, or has commas and no header.
    """
    if path.is_dir() or path.suffix == ".bin" or path.name == "images.txt":
        return "colmap"
    if path.suffix.lower() in (".json", ".sfm"):
        return detected_kind(path)
    table = read_table(read_text(path), path, delimiter)
    where, first = table.rows[0]
    named = table.named_columns()
    if named:
        return "euroc" if table.separator == "," and first[named.order[0]].isdigit() else "tum"
    if len(first) in KITTI_COLUMNS:
        return "kitti"
    if table.separator == "," and len(first) == _EUROC_COLUMNS:
        return "euroc"
    if len(first) != _TUM_COLUMNS:
        raise TrajectoryError(
            f"{where}: expected 8 columns (TUM), 12 (KITTI) or a header that names them, not {len(first)} columns"
        )
    if table.separator == ",":
        raise TrajectoryError(
            f"{where}: expected a header that says whether qw comes first, as in EuRoC's files, or last, as in TUM's; "
            "write 'timestamp,tx,ty,tz,qw,qx,qy,qz' or 'timestamp,tx,ty,tz,qx,qy,qz,qw' above it, or give the format"
        )
    return "tum"


def write_tum(trajectory: Trajectory, path: str | os.PathLike[str]) -> None:
    """Write lines of ``timestamp tx ty tz qx qy qz qw``, world_from_camera, with all digits.

    Raises
    ------
    TrajectoryError
        The file cannot be written.
    """
    rows = np.column_stack([trajectory.timestamps, trajectory.positions, trajectory.quaternions])
    _write(Path(path), "# timestamp tx ty tz qx qy qz qw (world_from_camera)\n", rows.tolist())


def write_kitti(trajectory: Trajectory, path: str | os.PathLike[str]) -> None:
    """Write lines of the 12 numbers of a (3, 4) matrix world_from_camera; timestamps and frame ids are lost.

    Raises
    ------
    TrajectoryError
        The file cannot be written.
    """
    rotations = trajectory.rotations.as_matrix() if len(trajectory) else np.empty((0, 3, 3))
    matrices = np.concatenate([rotations, trajectory.positions[:, :, np.newaxis]], axis=2)
    _write(Path(path), "", matrices.reshape(-1, 12).tolist())


def _write(path: Path, header: str, rows: Iterable[list[float]]) -> None:
    lines = "".join(" ".join(map(repr, row)) + "\n" for row in rows)
    try:
        path.write_text(header + lines, encoding="utf-8")
    except OSError as error:
        raise TrajectoryError(f"expected to write {path}, but that failed ({error.strerror})") from error
