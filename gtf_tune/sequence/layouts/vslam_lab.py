"""Read the sequences that VSLAM-LAB prepares: rgb.csv, calibration.yaml and groundtruth.csv."""

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

from gtf_tune.errors import SequenceError
from gtf_tune.sequence.camera import Camera
from gtf_tune.sequence.distortion import distorted_pinhole
from gtf_tune.sequence.layouts.base import (
    GIVE_THE_CAMERA,
    UNKNOWN,
    Intrinsics,
    Layout,
    Notes,
    Reading,
    Recording,
    check_unique,
    naming,
    one_camera,
)
from gtf_tune.sequence.layouts.fields import Field, read_yaml
from gtf_tune.sequence.layouts.ground_truth import poses_by_timestamp
from gtf_tune.sequence.layouts.tables import find_listed, read_text, to_nanoseconds, to_numbers
from gtf_tune.sequence.value import Frame
from gtf_tune.trajectory import Trajectory, read_trajectory

_CAMERA_KEYS = frozenset(
    {
        "cam_name",
        "cam_type",
        "cam_model",
        "focal_length",
        "principal_point",
        "image_dimension",
        "distortion_type",
        "distortion_model",
        "distortion_coefficients",
        "fps",
        "depth_name",
        "depth_factor",
    }
)


@dataclass(frozen=True)
class _Table:
    """Rows of a CSV file with a header, whose names may carry a unit such as ``ts (ns)``."""

    path: Path
    header: tuple[str, ...]
    rows: tuple[tuple[int, list[str]], ...]

    def column(self, name: str) -> int:
        """Return the number of the column whose name begins so, or raise `SequenceError`."""
        for number, title in enumerate(self.header):
            if title == name or title.startswith((f"{name} ", f"{name}_", f"{name}[")):
                return number
        raise SequenceError(f"{self.path}: expected a column '{name}', found {', '.join(self.header)}; check the file")

    def seconds(self, column: int) -> Callable[[str, int], float]:
        """Return what turns a cell of a column and its line into seconds, by the unit in the header."""
        title = self.header[column]
        if "(ns)" in title or "[ns]" in title:
            return lambda cell, line: to_nanoseconds(cell, self.path, line)
        if "(s)" in title or "[s]" in title:
            return lambda cell, line: to_numbers([cell], self.path, line)[0]
        raise SequenceError(f"{self.path}: expected the unit (ns) or (s) of column '{title}'; write it into the header")


def _read_table(path: Path) -> _Table:
    lines = enumerate(read_text(path).split("\n"), start=1)
    cells = [(number, [cell.strip() for cell in line.split(",")]) for number, line in lines if line.strip()]
    if not cells:
        raise SequenceError(f"{path}: expected a header, found an empty file; check the download")
    header = tuple(name.lstrip("# ").lower() for name in cells[0][1])
    for number, row in cells[1:]:
        if len(row) != len(header):
            raise SequenceError(
                f"{path}:{number}: expected {len(header)} fields as in the header, found {len(row)}; correct the line"
            )
    return _Table(path, header, tuple(cells[1:]))


def _read(root: Path, _: Reading) -> Recording:
    table = _read_table(root / "rgb.csv")
    path_column = table.column("path_rgb")
    frames = _frames(table, path_column)
    name = table.header[path_column].removeprefix("path_").split()[0]
    calibration, poses = root / "calibration.yaml", root / "groundtruth.csv"
    ground_truth, notes = _ground_truth(frames, poses) if poses.is_file() else (None, ())
    return Recording(
        frames,
        lambda: _intrinsics(calibration, name),
        ground_truth,
        notes=notes,
        files=(table.path, calibration, poses),
    )


def _frames(table: _Table, path_column: int) -> tuple[Frame, ...]:
    time_column = table.column("ts")
    seconds = table.seconds(time_column)
    frames = tuple(
        Frame(number, find_listed(table.path.parent, row[path_column], table.path), seconds(row[time_column], line))
        for number, (line, row) in enumerate(table.rows)
    )
    if not frames:
        raise SequenceError(f"{table.path}: lists no images; give a sequence that has some")
    check_unique(frames, table.path)
    return frames


def _ground_truth(frames: tuple[Frame, ...], path: Path) -> tuple[Trajectory | None, Notes]:
    table = _read_table(path)
    if not table.rows:
        return None, (f"{path.name} holds no poses",)
    with naming(path):
        return poses_by_timestamp(frames, read_trajectory(path, format="tum", delimiter=","), path)


def _intrinsics(path: Path, name: str) -> Intrinsics:
    if not path.is_file():
        return UNKNOWN
    cameras = list(read_yaml(path)["cameras"].items())
    camera = next((camera for camera in cameras if "cam_name" in camera and camera["cam_name"].value == name), None)
    if camera is None:
        raise SequenceError(f"{path}: expected a camera with cam_name '{name}', found none; {GIVE_THE_CAMERA}")
    others = camera.others(_CAMERA_KEYS)
    notes = (f"{path.name} has keys that are not read: {', '.join(others)}",) if others else ()
    with naming(path):
        return one_camera(_camera(camera), *notes)


def _camera(values: Field) -> Camera | None:
    kind = values["cam_model"].text().lower() if "cam_model" in values else "pinhole"
    if kind == "unknown":
        return None
    if kind != "pinhole":
        raise SequenceError(f"expected cam_model pinhole or unknown, found '{kind[:40]}'; {GIVE_THE_CAMERA}")
    focal = values["focal_length"].numbers(1, 2)
    width, height = values["image_dimension"].counts(2)
    named = values.first("distortion_type", "distortion_model")
    given = values.first("distortion_coefficients")
    return distorted_pinhole(
        named.text() if named else "none",
        given.numbers(*range(9)) if given else [],
        (focal[0], focal[-1], *values["principal_point"].numbers(2)),
        (width, height),
    )


VSLAM_LAB = Layout(
    name="vslam-lab",
    matches=lambda root: (root / "rgb.csv").is_file(),
    read=_read,
    help=(
        "VSLAM-LAB (https://github.com/VSLAM-LAB/VSLAM-LAB): download a sequence with it and give its folder in "
        "VSLAM-LAB-Benchmark, which holds rgb.csv, rgb_0/, calibration.yaml and groundtruth.csv."
    ),
)
