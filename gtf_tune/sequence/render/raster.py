"""Draw flat textured faces as a pinhole camera sees them, exactly and without aliasing.

A face's texture coordinates are a homography of the pixel, and the inverse depth is its third row, so that visibility
needs only linear forms in the pixel coordinates. Textures are sampled trilinearly from mip maps.
"""

from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from gtf_tune.sequence.camera import Camera
from gtf_tune.sequence.render.scene import Face, FloatArray
from gtf_tune.sequence.render.textures import Texture

FloatImage = NDArray[np.float32]

_SMALLEST_MIP = 4
# Where inside the pixel a sample lies (rotated grid) matters as much as the mip level: four samples share the blur.
_FOOTPRINT_PER_SAMPLE = 0.6
_NEAR_M = 0.05


@dataclass(frozen=True, eq=False)
class TextureAtlas:
    """Mip maps of all faces in one flat array.

    ``texels`` is flat; ``offsets``, ``widths`` and ``heights`` have the shape (faces, levels); levels beyond the
    smallest repeat it.
    """

    texels: FloatImage
    offsets: NDArray[np.int64]
    widths: NDArray[np.int64]
    heights: NDArray[np.int64]


def build_atlas(faces: tuple[Face, ...]) -> TextureAtlas:
    """Return the mip maps of all faces."""
    pyramids = [_pyramid(face.texture) for face in faces]
    levels = max(len(pyramid) for pyramid in pyramids)
    padded = [pyramid + [pyramid[-1]] * (levels - len(pyramid)) for pyramid in pyramids]
    sizes = np.array([[level.shape for level in pyramid] for pyramid in padded])
    ends = sizes.prod(axis=2).cumsum().reshape(sizes.shape[:2])
    texels = np.concatenate([level.ravel() for pyramid in padded for level in pyramid])
    return TextureAtlas(texels, ends - sizes.prod(axis=2), sizes[..., 1], sizes[..., 0])


def draw(faces: tuple[Face, ...], atlas: TextureAtlas, camera: Camera, world_from_camera: FloatArray) -> FloatImage:
    """Return one sample per pixel, in grey levels, of shape (height, width); 0 where there is no face.

    Parameters
    ----------
    faces, atlas
        The scene and its `build_atlas`.
    camera
        PINHOLE; the sample is taken at the pixel centres.
    world_from_camera
        4x4 pose of a camera that looks along +z, x to the right, y down.
    """
    homographies = np.stack([_face_from_pixel(face, camera, world_from_camera) for face in faces])
    visible = _visible_faces(faces, homographies, camera, world_from_camera)
    image = np.zeros(visible.shape, np.float32)
    rows, columns = np.nonzero(visible >= 0)
    x, y = columns.astype(np.float64) + 0.5, rows.astype(np.float64) + 0.5
    image[rows, columns] = _shade(visible[rows, columns], homographies, atlas, (x, y))
    return image


def _pyramid(texture: Texture) -> list[Texture]:
    levels = [texture]
    while min(levels[-1].shape) >= 2 * _SMALLEST_MIP:
        height, width = levels[-1].shape
        levels.append(cv2.resize(levels[-1], (width // 2, height // 2), interpolation=cv2.INTER_AREA))
    return levels


def _face_from_pixel(face: Face, camera: Camera, world_from_camera: FloatArray) -> FloatArray:
    """Return the 3x3 matrix H with (u, v, 1) = z H (x, y, 1) for the pixel (x, y) that sees the face at depth z.

    All zero, which is never visible, if the camera lies in the plane of the face.
    """
    fx, fy, cx, cy = camera.params
    intrinsics = np.array([[fx, 0, cx], [0, fy, cy], [0, 0, 1]])
    rotation, centre = world_from_camera[:3, :3], world_from_camera[:3, 3]
    pixel_from_face = intrinsics @ rotation.T @ np.column_stack([face.right, face.down, face.corner - centre])
    if np.linalg.cond(pixel_from_face) > 1e12:
        return np.zeros((3, 3))
    return np.asarray(np.linalg.inv(pixel_from_face), dtype=np.float64)


def _visible_faces(
    faces: tuple[Face, ...], homographies: FloatArray, camera: Camera, world_from_camera: FloatArray
) -> NDArray[np.int64]:
    """Return the index of the nearest face in each pixel, -1 where there is none."""
    nearest = np.zeros((camera.height, camera.width), np.float32)
    indices = np.full((camera.height, camera.width), -1, np.int64)
    for index, (face, matrix) in enumerate(zip(faces, homographies, strict=True)):
        rows, columns = _bounds(face, camera, world_from_camera)
        y, x = np.arange(camera.height)[rows, None] + 0.5, np.arange(camera.width)[None, columns] + 0.5
        u, v, inverse_depth = ((row[0] * x + (row[1] * y + row[2])).astype(np.float32) for row in matrix)
        inside = (u >= 0) & (v >= 0) & (u <= inverse_depth) & (v <= inverse_depth)
        inside &= inverse_depth > nearest[rows, columns]
        nearest[rows, columns][inside] = inverse_depth[inside]
        indices[rows, columns][inside] = index
    return indices


def _bounds(face: Face, camera: Camera, world_from_camera: FloatArray) -> tuple[slice, slice]:
    """Return the rows and columns that can see the face; all of them if it reaches behind the camera."""
    ends = np.array([(0, 0), (1, 0), (0, 1), (1, 1)])
    points = face.corner + ends @ np.stack([face.right, face.down]) - world_from_camera[:3, 3]
    x, y, z = (points @ world_from_camera[:3, :3]).T
    if (z < -_NEAR_M).all():
        return slice(0, 0), slice(0, 0)
    if (z < _NEAR_M).any():
        return slice(None), slice(None)
    fx, fy, cx, cy = camera.params
    columns, rows = fx * x / z + cx, fy * y / z + cy
    return _clipped(rows, camera.height), _clipped(columns, camera.width)


def _clipped(values: FloatArray, size: int) -> slice:
    low, high = np.clip([values.min() - 1, values.max() + 1], 0, size)
    return slice(int(low), int(np.ceil(high)))


def _shade(
    faces: NDArray[np.int64], homographies: FloatArray, atlas: TextureAtlas, pixels: tuple[FloatArray, FloatArray]
) -> FloatImage:
    """Return the grey levels (n,) of n pixels x, y that see these faces."""
    forms = homographies[faces].transpose(1, 2, 0)
    inverse_depth = _linear(forms[2], pixels)
    u, v = _linear(forms[0], pixels) / inverse_depth, _linear(forms[1], pixels) / inverse_depth
    # d(u, v) / d(x, y) by the quotient rule, in texels of the finest level per pixel.
    across = (forms[0, :2] - u * forms[2, :2]) * atlas.widths[faces, 0] / inverse_depth
    down = (forms[1, :2] - v * forms[2, :2]) * atlas.heights[faces, 0] / inverse_depth
    footprint = np.sqrt((across**2 + down**2).max(axis=0)) * _FOOTPRINT_PER_SAMPLE
    level = np.clip(np.log2(np.maximum(footprint, 1.0)), 0, atlas.offsets.shape[1] - 1.001)
    lower = level.astype(np.int64)
    fine, coarse = (_bilinear(atlas, faces, lower + step, (u, v)) for step in (0, 1))
    blended: FloatImage = fine + (level - lower).astype(np.float32) * (coarse - fine)
    return blended


def _linear(form: FloatArray, pixels: tuple[FloatArray, FloatArray]) -> FloatArray:
    return np.asarray(form[0] * pixels[0] + form[1] * pixels[1] + form[2])


def _bilinear(
    atlas: TextureAtlas, faces: NDArray[np.int64], level: NDArray[np.int64], uv: tuple[FloatArray, FloatArray]
) -> FloatImage:
    offset, width, height = (table[faces, level] for table in (atlas.offsets, atlas.widths, atlas.heights))
    column = np.clip(uv[0] * width - 0.5, 0, width - 1.001)
    row = np.clip(uv[1] * height - 0.5, 0, height - 1.001)
    left, top = column.astype(np.int64), row.astype(np.int64)
    across, down = (column - left).astype(np.float32), (row - top).astype(np.float32)
    first = offset + top * width + left
    texels = atlas.texels
    upper = texels[first] + across * (texels[first + 1] - texels[first])
    below = first + width
    lower = texels[below] + across * (texels[below + 1] - texels[below])
    mixed: FloatImage = upper + down * (lower - upper)
    return mixed
