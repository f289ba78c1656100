"""Read the camera poses of reconstructions in JSON, as nerfstudio, OpenSfM (ODM) and AliceVision (Meshroom) write them.

All of them name the images, so their poses are associated by name. Conventions are from the documentation of the
programs: docs.nerf.studio (transforms.json), opensfm.org (reconstruction.json), and the AliceVision sources
(sfmDataIO/jsonIO).
"""

from collections.abc import Callable, Mapping, Sequence
from pathlib import Path, PurePosixPath
from types import MappingProxyType
from typing import Any

import numpy as np
from numpy.typing import ArrayLike
from scipy.spatial.transform import Rotation

from gtf_tune.errors import TrajectoryError
from gtf_tune.input_files import parse_json
from gtf_tune.trajectory.colmap import named_trajectory
from gtf_tune.trajectory.formats import UNIT_TOLERANCE, read_text
from gtf_tune.trajectory.value import FloatArray, Trajectory

# From OpenGL's camera axes (right, up, backward) to OpenCV's (right, down, forward).
_OPENCV_FROM_OPENGL = np.diag([1.0, -1.0, -1.0])
_NAMES = MappingProxyType({"transforms": "transforms.json", "opensfm": "reconstruction.json", "sfmdata": "SfMData"})

_Pose = tuple[str, FloatArray, FloatArray]
"""Name of an image, position of its camera, (3,), and rotation world_from_camera, (3, 3)."""


def read_reconstruction(path: Path, kind: str) -> Trajectory:
    """Read a reconstruction in JSON; of several in one file the largest counts.

    The names are those of the image files, with their folders only where these are needed to tell images apart.

    Frame ids and times come from the names as in a COLMAP model (see `gtf_tune.trajectory.colmap.read_colmap`). Camera
    axes become OpenCV's (right, down, forward).

    Parameters
    ----------
    path
        A ``transforms.json`` of nerfstudio or instant-ngp, a ``reconstruction.json`` of OpenSfM, or an SfMData file
        (``.sfm``, ``.json``) of AliceVision.
    kind
        ``transforms``, ``opensfm`` or ``sfmdata``.

    Raises
    ------
    TrajectoryError
        The file is none of them, is malformed (the message names the key), or holds no poses.
    """
    content = _content(path)
    if kind != (_kind(content) or ""):
        raise TrajectoryError(f"expected the poses of a reconstruction in {path} ({_NAMES[kind]}), but it holds none")
    poses = _READERS[kind](content, path)
    if not poses:
        raise TrajectoryError(f"expected at least one image with a pose in {path}, but it holds none")
    names, positions, rotations = zip(*poses, strict=True)
    return named_trajectory(_shortest(names), np.array(positions), Rotation.from_matrix(np.array(rotations)), path)


def detected_kind(path: Path) -> str:
    """Return which kind of reconstruction a file is.

    Raises
    ------
    TrajectoryError
        The file cannot be read, or is none.
    """
    kind = _kind(_content(path))
    if kind is None:
        raise TrajectoryError(
            f"expected the poses of a reconstruction in {path} ({', '.join(_NAMES.values())}), but it holds none"
        )
    return kind


def _content(path: Path) -> Any:
    try:
        return parse_json(read_text(path))
    except ValueError as error:
        raise TrajectoryError(f"expected JSON in {path}, but it is not ({error})") from error


def _kind(content: object) -> str | None:
    if isinstance(content, dict) and isinstance(content.get("frames"), list):
        return "transforms"
    if isinstance(content, dict) and isinstance(content.get("views"), list):
        return "sfmdata"
    parts = content if isinstance(content, list) else []
    return "opensfm" if any(isinstance(part, dict) and "shots" in part for part in parts) else None


def _of_transforms(content: Any, path: Path) -> list[_Pose]:
    poses = []
    for index, frame in enumerate(content["frames"]):
        where = f"{path}: frames[{index}]"
        matrix = _numbers(_value(frame, "transform_matrix", where), (4, 4), f"{where}.transform_matrix")
        name = _text(_value(frame, "file_path", where), f"{where}.file_path")
        rotation = _rotation(matrix[:3, :3] @ _OPENCV_FROM_OPENGL, f"{where}.transform_matrix")
        poses.append((name, matrix[:3, 3], rotation))
    return poses


def _of_opensfm(content: Any, path: Path) -> list[_Pose]:
    """Return the poses of the largest of the reconstructions; OpenSfM stores camera_from_world, turns as vectors."""
    parts = [part["shots"] for part in content if isinstance(part, dict) and isinstance(part.get("shots"), dict)]
    poses = []
    for name, shot in max(parts, key=len, default={}).items():
        where = f"{path}: shots['{name}']"
        turn = Rotation.from_rotvec(_numbers(_value(shot, "rotation", where), (3,), f"{where}.rotation")).inv()
        translation = _numbers(_value(shot, "translation", where), (3,), f"{where}.translation")
        poses.append((name, -turn.apply(translation), turn.as_matrix()))
    return poses


def _of_sfmdata(content: Any, path: Path) -> list[_Pose]:
    """Return the poses of the views that have one; rotations are camera_from_world, column by column."""
    stored = content.get("poses") or []
    if not isinstance(stored, list):
        raise TrajectoryError(f"{path}: expected a list under the key poses, not {type(stored).__name__}")
    by_id = {str(_value(pose, "poseId", f"{path}: poses[{index}]")): pose for index, pose in enumerate(stored)}
    poses = []
    for index, view in enumerate(content["views"]):
        where = f"{path}: views[{index}]"
        pose_id = str(_value(view, "poseId", where))
        if pose_id in by_id:
            name = _text(_value(view, "path", where), f"{where}.path")
            place = f"{path}: pose {pose_id}"
            transform = _value(_value(by_id[pose_id], "pose", place), "transform", place)
            centre = _numbers(_value(transform, "center", place), (3,), f"{place}.center")
            matrix = _numbers(_value(transform, "rotation", place), (9,), f"{place}.rotation").reshape(3, 3)
            poses.append((name, centre, _rotation(matrix, f"{place}.rotation")))
    return poses


_READERS: Mapping[str, Callable[[Any, Path], list[_Pose]]] = MappingProxyType(
    {"transforms": _of_transforms, "opensfm": _of_opensfm, "sfmdata": _of_sfmdata}
)


def _shortest(names: Sequence[str]) -> list[str]:
    paths = [PurePosixPath(name.replace("\\", "/")) for name in names]
    files = [path.name for path in paths]
    return files if len(set(files)) == len(files) else [str(path) for path in paths]


def _value(mapping: object, key: str, where: str) -> Any:
    if not isinstance(mapping, dict) or key not in mapping:
        raise TrajectoryError(f"{where}: expected a key '{key}', found none; check the file")
    return mapping[key]


def _text(value: object, where: str) -> str:
    if not isinstance(value, str) or not value or "\0" in value:
        raise TrajectoryError(f"{where}: expected the name of an image, not {value!r:.60}")
    return value


def _numbers(value: ArrayLike, shape: tuple[int, ...], where: str) -> FloatArray:
    """Return finite numbers of a shape; SfMData writes them as texts."""
    expected = f"{' x '.join(map(str, shape))} finite numbers"
    try:
        found = np.array(value, dtype=np.float64)
    except (TypeError, ValueError, OverflowError) as error:
        raise TrajectoryError(f"{where}: expected {expected} ({error})") from error
    if found.shape != shape or not np.isfinite(found).all():
        raise TrajectoryError(f"{where}: expected {expected}, not {value!r:.60}")
    return found


def _rotation(matrix: FloatArray, where: str) -> FloatArray:
    """Return a rotation, which nerfstudio's viewers scale at times; a mirrored or skewed matrix is none."""
    determinant = float(np.linalg.det(matrix))
    scaled = matrix / np.cbrt(determinant) if determinant > 0 else matrix
    if determinant <= 0 or np.abs(scaled @ scaled.T - np.eye(3)).max() > UNIT_TOLERANCE:
        raise TrajectoryError(f"{where}: expected a rotation, but it is skewed, mirrored or empty")
    return scaled
