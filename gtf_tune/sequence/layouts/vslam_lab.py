"""Read the sequences that VSLAM-LAB prepares: rgb.csv, calibration.yaml and groundtruth.csv."""

import re
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from natsort import natsorted

from gtf_tune.errors import SequenceError
from gtf_tune.sequence.camera import Camera
from gtf_tune.sequence.distortion import distorted_pinhole, is_distortion
from gtf_tune.sequence.images import image_size
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
from gtf_tune.sequence.layouts.ground_truth import mirrored, poses_by_timestamp
from gtf_tune.sequence.layouts.tables import find_listed, in_seconds, read_text, shortened
from gtf_tune.sequence.value import Frame
from gtf_tune.trajectory import Trajectory, read_trajectory
from gtf_tune.trajectory.columns import time_unit

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
        "T_BS",
    }
)
_PATH = re.compile(r"path_(rgb[_0-9]*)")


@dataclass(frozen=True)
class _Table:
    """Rows of a CSV file with a header, whose names may carry a unit such as ``ts (ns)``."""

    path: Path
    header: tuple[str, ...]
    rows: tuple[tuple[int, list[str]], ...]

    def images(self) -> dict[str, int]:
        """Return the columns of images by the names of their cameras, ``rgb_0`` before ``rgb_1``."""
        found = {match[1]: column for column, name in enumerate(self.header) if (match := _PATH.fullmatch(name))}
        if not found:
            raise self._without("path_rgb_0")
        return {name: found[name] for name in natsorted(found)}

    def times(self, camera: str) -> tuple[int, str]:
        """Return the column of the times of a camera and their unit, empty where the header does not say it."""
        for prefix in (f"_{camera}", ""):
            for column, title in enumerate(self.header):
                named = time_unit(title.replace(prefix, "", 1)) if prefix in title else None
                if named is not None:
                    return column, named
        raise self._without(f"ts_{camera} (ns)")

    def _without(self, name: str) -> SequenceError:
        return SequenceError(f"{self.path}: expected a column '{name}', found {', '.join(self.header)}; check the file")


def _read_table(path: Path) -> _Table:
    lines = enumerate(read_text(path).split("\n"), start=1)
    cells = [(number, [cell.strip("\"' \r") for cell in line.split(",")]) for number, line in lines if line.strip()]
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
    camera, *others = table.images()
    frames = _frames(table, camera)
    calibration, poses = root / "calibration.yaml", root / "groundtruth.csv"
    upward = _has_y_upward(calibration, camera)
    ground_truth, notes = _ground_truth(frames, poses, upward=upward) if poses.is_file() else (None, ())
    if upward:
        notes = (*notes, f"{calibration.name} has a focal length below 0 as y points up: camera and poses are mirrored")
    if others:
        notes = (*notes, f"{table.path.name} lists the images of several cameras; those of {camera} are used")
    return Recording(
        frames,
        lambda: _intrinsics(calibration, camera, frames[0].path, has_poses=ground_truth is not None),
        ground_truth,
        notes=notes,
        files=(table.path, calibration, poses),
    )


def _frames(table: _Table, camera: str) -> tuple[Frame, ...]:
    if not table.rows:
        raise SequenceError(f"{table.path}: lists no images; give a sequence that has some")
    path_column, (time_column, unit) = table.images()[camera], table.times(camera)
    stamps = [(line, row[time_column]) for line, row in table.rows]
    usual = "s" if any("." in text for _, text in stamps) else ""
    times = in_seconds(stamps, unit, usual, table.path)
    frames = tuple(
        Frame(number, find_listed(table.path.parent, row[path_column], table.path), time)
        for number, ((_, row), time) in enumerate(zip(table.rows, times, strict=True))
    )
    check_unique(frames, table.path)
    return frames


def _ground_truth(frames: tuple[Frame, ...], path: Path, *, upward: bool) -> tuple[Trajectory | None, Notes]:
    table = _read_table(path)
    if not table.rows:
        return None, (f"{path.name} holds no poses",)
    with naming(path):
        poses = read_trajectory(path, format="tum", delimiter=",")
    return poses_by_timestamp(frames, mirrored(poses) if upward else poses, path)


def _has_y_upward(path: Path, name: str) -> bool:
    """Return True if a camera is described by a negative vertical focal length, as those of ICL-NUIM are."""
    if not path.is_file():
        return False
    try:
        return _described(path, name)["focal_length"].numbers(1, 2)[-1] < 0
    except SequenceError:
        return False  # which matters only where the intrinsics are needed


def _intrinsics(path: Path, name: str, image: Path, *, has_poses: bool) -> Intrinsics:
    if not path.is_file():
        return UNKNOWN
    camera = _described(path, name)
    others = camera.others(_CAMERA_KEYS)
    notes = [f"{path.name} has keys that are not read: {', '.join(others)}"] if others else []
    if has_poses and "T_BS" in camera and not np.array_equal(camera["T_BS"].matrix(4, 4), np.eye(4)):
        notes.append(f"ground truth is taken for poses of the camera, though {path.name} has a T_BS that moves it")
    with naming(path):
        return one_camera(_camera(camera, image), *notes)


def _described(path: Path, name: str) -> Field:
    """Return what a calibration says of the camera of a name, or raise `SequenceError` if it has none."""
    cameras = list(read_yaml(path)["cameras"].items())
    named = {camera["cam_name"].text(): camera for camera in cameras if "cam_name" in camera}
    camera = named.get(name) or next((named[key] for key in named if _plain(key) == _plain(name)), None)
    if camera is None:
        known = ", ".join(named) or "none"
        raise SequenceError(
            f"{path}: expected a camera with cam_name '{name}', found {shortened(known)}; {GIVE_THE_CAMERA}"
        )
    return camera


def _plain(name: str) -> str:
    """Return the name of a camera without what spellings differ in, as rgb0 and rgb_0 do."""
    return name.lower().replace("_", "")


def _camera(values: Field, image: Path) -> Camera | None:
    kind = values["cam_model"].text().lower() if "cam_model" in values else "pinhole"
    if kind == "unknown":
        return None
    named = values.first("distortion_type", "distortion_model")
    given = values.first("distortion_coefficients")
    if kind != "pinhole" and not (is_distortion(kind) and given):
        raise SequenceError(f"expected cam_model pinhole or unknown, found '{kind[:40]}'; {GIVE_THE_CAMERA}")
    focal = values["focal_length"].numbers(1, 2)
    distortion = named.text() if named else "none" if kind == "pinhole" else kind
    return distorted_pinhole(
        distortion,
        given.numbers(*range(9)) if given else [],
        (focal[0], abs(focal[-1]), *values["principal_point"].numbers(2)),
        _size(values, image),
    )


def _size(values: Field, image: Path) -> tuple[int, int]:
    """Return (width, height); VSLAM-LAB writes zeros where it cannot read an image itself."""
    given = values.first("image_dimension")
    if given is None or given.value == ["0", "0"]:
        return image_size(image)
    width, height = given.counts(2)
    return width, height


VSLAM_LAB = Layout(
    name="vslam-lab",
    matches=lambda root: (root / "rgb.csv").is_file(),
    read=_read,
    help=(
        "VSLAM-LAB (https://github.com/VSLAM-LAB/VSLAM-LAB): download a sequence with it and give its folder in "
        "VSLAM-LAB-Benchmark, which holds rgb.csv, rgb_0/, calibration.yaml and groundtruth.csv."
    ),
)
