"""Read the models that COLMAP writes, as trajectories and as what nerfstudio reads."""

import json
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import pycolmap

from gtf_tune.errors import RunError, TrajectoryError
from gtf_tune.trajectory import Trajectory

# COLMAP's cameras look along +z with y down, OpenGL's along -z with y up.
_OPENGL_AXES = np.diag([1.0, -1.0, -1.0, 1.0])
# https://docs.nerf.studio/quickstart/data_conventions.html
_NERFSTUDIO_MODELS = {
    "SIMPLE_PINHOLE": "PINHOLE",
    "PINHOLE": "PINHOLE",
    "SIMPLE_RADIAL": "OPENCV",
    "RADIAL": "OPENCV",
    "OPENCV": "OPENCV",
    "OPENCV_FISHEYE": "OPENCV_FISHEYE",
    "SIMPLE_RADIAL_FISHEYE": "OPENCV_FISHEYE",
    "RADIAL_FISHEYE": "OPENCV_FISHEYE",
}
_NERFSTUDIO_NAMES = {"k": "k1", "f": "fl", "fx": "fl_x", "fy": "fl_y"}


@dataclass(frozen=True)
class SparseModel:
    """A sparse model in the frame and unit that the mapper gave it.

    ``trajectory`` has the poses of the registered images in the order of their names, world_from_camera.
    """

    trajectory: Trajectory
    num_points: int
    mean_track_length: float
    mean_reprojection_error_px: float


def read_model(folder: Path, frames: Mapping[str, tuple[int, float]]) -> SparseModel:
    """Return what a model in COLMAP's format holds.

    Parameters
    ----------
    folder
        The folder with ``images.bin`` and its neighbours.
    frames
        Frame id and timestamp in seconds by the name of the image.

    Raises
    ------
    RunError
        The model cannot be read, or holds images of other names.
    """
    model = read_reconstruction(folder)
    poses = {
        model.images[image_id].name: model.images[image_id].cam_from_world().inverse()
        for image_id in model.reg_image_ids()
    }
    unknown = sorted(set(poses) - set(frames))
    if unknown:
        raise RunError(f"the model in {folder} holds image '{unknown[0]}', which is not among those reconstructed")
    names = sorted(poses, key=lambda name: frames[name][0])
    try:
        trajectory = Trajectory(
            frame_ids=np.array([frames[name][0] for name in names], dtype=np.int64),
            timestamps=np.array([frames[name][1] for name in names]),
            positions=np.array([poses[name].translation for name in names]),
            quaternions=np.array([poses[name].rotation.quat for name in names]),
            names=tuple(names),
        )
    except TrajectoryError as error:
        raise RunError(f"the poses of the model in {folder} are unusable: {error}") from error
    return SparseModel(
        trajectory,
        int(model.num_points3D()),
        float(model.compute_mean_track_length()),
        float(model.compute_mean_reprojection_error()),
    )


def transforms_json(folder: Path, images: Path) -> str:
    """Return the cameras of a model as a ``transforms.json`` that nerfstudio reads.

    Where the images have several cameras, each frame has the intrinsics of its own. Poses are world_from_camera in
    OpenGL's axes (x right, y up, z backwards). ``images`` is the folder of the images.

    Raises
    ------
    RunError
        The model cannot be read, or its camera model is unknown to nerfstudio.
    """
    model = read_reconstruction(folder)
    registered = sorted((model.images[image_id] for image_id in model.reg_image_ids()), key=lambda one: str(one.name))
    used = {image.camera_id: _intrinsics(model.cameras[image.camera_id]) for image in registered}
    frames = []
    for image in registered:
        pose = np.vstack([image.cam_from_world().inverse().matrix(), [0.0, 0.0, 0.0, 1.0]]) @ _OPENGL_AXES
        frame = {"file_path": str(images / image.name), "transform_matrix": pose.tolist()}
        frames.append({**frame, **used[image.camera_id]} if len(used) > 1 else frame)
    if len(used) == 1:
        return json.dumps({**used.popitem()[1], "frames": frames}, indent=1) + "\n"
    models = {str(lens["camera_model"]) for lens in used.values()}
    shared = {"camera_model": models.pop()} if len(models) == 1 else {}
    return json.dumps({**shared, "frames": frames}, indent=1) + "\n"


def _intrinsics(camera: Any) -> dict[str, Any]:
    name = str(camera.model.name)
    if name not in _NERFSTUDIO_MODELS:
        raise RunError(f"nerfstudio knows no camera model like COLMAP's {name}")
    given = zip((name.strip() for name in camera.params_info.split(",")), camera.params.tolist(), strict=True)
    found = {_NERFSTUDIO_NAMES.get(key, key): float(value) for key, value in given}
    shared = found.pop("fl", None)
    if shared is not None:
        found |= {"fl_x": shared, "fl_y": shared}
    return {"camera_model": _NERFSTUDIO_MODELS[name], "w": int(camera.width), "h": int(camera.height), **found}


def read_reconstruction(folder: Path) -> Any:
    """Return a model in COLMAP's format as pycolmap's object.

    Raises
    ------
    RunError
        The model cannot be read.
    """
    try:
        return pycolmap.Reconstruction(folder)
    except (RuntimeError, ValueError, OSError) as error:
        raise RunError(f"no COLMAP model can be read from {folder} ({error})") from error
