"""Read the points and cameras of a sparse model as a picture of it shows them."""

from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from gtf_tune.pipelines.colmap.models import read_reconstruction
from gtf_tune.trajectory import FloatArray, IntArray

MOST_POINTS = 4000
_LONG_TRACK = 3


@dataclass(frozen=True, eq=False)
class SparseCloud:
    """Points and cameras of a model, in the frame and unit of the model.

    Attributes
    ----------
    points
        (n, 3) positions of at most `MOST_POINTS` points.
    colours
        (n, 3) their colours, red, green and blue from 0 to 255.
    names
        Names of the m registered images.
    centres
        (m, 3) camera centres.
    corners
        (m, 4, 3) vectors from each centre to the corners of its image at depth 1, in turn around the image.
    axes
        (m, 3, 3) rows are the x (right), y (down) and z (forward) axis of each camera.
    num_points
        Points of the whole model.
    error_px
        Mean reprojection error.
    """

    points: FloatArray
    colours: IntArray
    names: tuple[str, ...]
    centres: FloatArray
    corners: FloatArray
    axes: FloatArray
    num_points: int
    error_px: float


def read_cloud(folder: Path) -> SparseCloud:
    """Return what a picture of a model in COLMAP's format shows; points of two images only where there are few others.

    Raises
    ------
    RunError
        The model cannot be read.
    """
    model = read_reconstruction(folder)
    images = sorted((model.images[image_id] for image_id in model.reg_image_ids()), key=lambda image: str(image.name))
    poses = [image.cam_from_world() for image in images]
    axes = np.array([pose.rotation.matrix() for pose in poses], dtype=np.float64).reshape(-1, 3, 3)
    rays = np.array([_corner_rays(model.cameras[image.camera_id]) for image in images]).reshape(-1, 4, 3)
    points = list(model.points3D.values())
    order = np.random.default_rng(0).permutation(len(points))
    is_short = np.array([points[place].track.length() < _LONG_TRACK for place in order], dtype=bool)
    kept = [points[place] for place in order[np.argsort(is_short, kind="stable")][:MOST_POINTS]]
    return SparseCloud(
        points=np.array([point.xyz for point in kept], dtype=np.float64).reshape(-1, 3),
        colours=np.array([point.color for point in kept], dtype=np.int64).reshape(-1, 3),
        names=tuple(str(image.name) for image in images),
        centres=np.array([pose.inverse().translation for pose in poses], dtype=np.float64).reshape(-1, 3),
        corners=np.einsum("mij,mki->mkj", axes, rays),
        axes=axes,
        num_points=len(points),
        error_px=float(model.compute_mean_reprojection_error()),
    )


def _corner_rays(camera: Any) -> FloatArray:
    """Return the corners of a pinhole image of this size and focal length at depth 1, (4, 3) in the camera's frame."""
    x, y = (0.5 * side / camera.mean_focal_length() for side in (camera.width, camera.height))
    return np.array([[-x, -y, 1.0], [x, -y, 1.0], [x, y, 1.0], [-x, y, 1.0]])
