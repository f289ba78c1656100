"""Intrinsics of a camera in COLMAP's models and conventions."""

import hashlib
import json
import math
from collections.abc import Sequence as Items
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from gtf_tune.errors import SequenceError

# https://github.com/colmap/colmap/blob/main/src/colmap/sensor/models.h, in the order of COLMAP's model ids.
MODEL_PARAMS: dict[str, str] = {
    "SIMPLE_PINHOLE": "f cx cy",
    "PINHOLE": "fx fy cx cy",
    "SIMPLE_RADIAL": "f cx cy k",
    "RADIAL": "f cx cy k1 k2",
    "OPENCV": "fx fy cx cy k1 k2 p1 p2",
    "OPENCV_FISHEYE": "fx fy cx cy k1 k2 k3 k4",
    "FULL_OPENCV": "fx fy cx cy k1 k2 p1 p2 k3 k4 k5 k6",
    "FOV": "fx fy cx cy omega",
    "SIMPLE_RADIAL_FISHEYE": "f cx cy k",
    "RADIAL_FISHEYE": "f cx cy k1 k2",
    "THIN_PRISM_FISHEYE": "fx fy cx cy k1 k2 p1 p2 k3 k4 sx1 sy1",
    "RAD_TAN_THIN_PRISM_FISHEYE": "fx fy cx cy k0 k1 k2 k3 k4 k5 p0 p1 s0 s1 s2 s3",
    "SIMPLE_DIVISION": "f cx cy k",
    "DIVISION": "fx fy cx cy k",
    "SIMPLE_FISHEYE": "f cx cy",
    "FISHEYE": "fx fy cx cy",
    "EUCM": "fx fy cx cy alpha beta",
    "EQUIRECTANGULAR": "w h",
}
"""Names of the parameters of each COLMAP camera model; the position in the table is COLMAP's model id."""

_HORIZONTAL = {"fx", "cx", "w"}
_VERTICAL = {"fy", "cy", "h"}
_POSITIVE = {"f", "fx", "fy", "w", "h"}
_ASPECT_TOLERANCE = 0.02
_LARGEST_SIDE = 1_000_000
_SKEW_TOLERANCE = 1e-3


@dataclass(frozen=True)
class Camera:
    """Intrinsics: a COLMAP camera model, the size in pixels of the images it describes, and its parameters.

    The centre of the top left pixel is at (0.5, 0.5), as in COLMAP. OpenCV and most data sets put it at (0, 0): use
    `pinhole_from_opencv` for their numbers.

    Raises
    ------
    SequenceError
        The model is unknown, or a parameter is missing, not finite or impossible.
    """

    model: str
    width: int
    height: int
    params: tuple[float, ...]

    def __post_init__(self) -> None:
        object.__setattr__(self, "params", tuple(float(value) for value in self.params))
        if self.model not in MODEL_PARAMS:
            known = ", ".join(MODEL_PARAMS)
            raise SequenceError(f"unknown camera model '{self.model}'; COLMAP's models are {known}")
        names = self.param_names
        if len(self.params) != len(names):
            raise SequenceError(
                f"camera model {self.model} takes {len(names)} parameters ({' '.join(names)}), not {len(self.params)}"
            )
        if not (1 <= self.width <= _LARGEST_SIDE and 1 <= self.height <= _LARGEST_SIDE):
            raise SequenceError(
                f"a camera needs an image size of 1 to {_LARGEST_SIDE} pixels a side, not "
                f"{self.width:.0f}x{self.height:.0f}"
            )
        for name, value in zip(names, self.params, strict=True):
            if not math.isfinite(value) or (name in _POSITIVE and value <= 0):
                raise SequenceError(
                    f"camera parameter {name} of {self.model} cannot be {value:g}; check the intrinsics"
                )

    @property
    def param_names(self) -> tuple[str, ...]:
        """Return the names of the parameters, in order."""
        return tuple(MODEL_PARAMS[self.model].split())

    @property
    def size(self) -> tuple[int, int]:
        """Return (width, height) in pixels."""
        return self.width, self.height

    @property
    def key(self) -> str:
        """Return the hex SHA-256 of the model, the size and the exact parameters."""
        text = json.dumps([self.model, self.width, self.height, [repr(value) for value in self.params]])
        return hashlib.sha256(text.encode()).hexdigest()

    def scaled(self, width: int, height: int) -> "Camera":
        """Return the camera of the same images resized to ``width`` x ``height`` pixels.

        Exact for resizing by pixel areas, because corners are at whole numbers and so map onto corners. One shared
        focal length follows the mean of the two factors, as in COLMAP.
        """
        across, down = width / self.width, height / self.height
        factors = (
            {name: across for name in _HORIZONTAL} | {name: down for name in _VERTICAL} | {"f": (across + down) / 2}
        )
        params = (value * factors.get(name, 1.0) for name, value in zip(self.param_names, self.params, strict=True))
        return Camera(self.model, width, height, tuple(params))

    def fitted(self, width: int, height: int) -> "Camera":
        """Return the camera of the same images in another resolution, or raise `SequenceError` if they were cut."""
        if (width, height) == (self.width, self.height):
            return self
        cut = (width == self.width or height == self.height) and abs(width - self.width + height - self.height) > 1
        if cut or abs(width * self.height / (height * self.width) - 1) > _ASPECT_TOLERANCE:
            raise SequenceError(
                f"the intrinsics are for {self.width}x{self.height} images, but the images are {width}x{height}, "
                "which is another shape: cropped, padded or turned; give the intrinsics of these images"
            )
        return self.scaled(width, height)


@dataclass(frozen=True)
class Lens:
    """Intrinsics given by hand, for the images as they are stored: a COLMAP model and its parameters."""

    model: str
    params: Items[float]

    def camera(self, width: int, height: int) -> Camera:
        """Return the camera of stored images of this size, or raise `SequenceError` for impossible parameters."""
        return Camera(self.model, width, height, tuple(self.params))


def pinhole_from_opencv(focal: tuple[float, float], centre: tuple[float, float], size: tuple[int, int]) -> Camera:
    """Return a PINHOLE camera from (fx, fy), (cx, cy) and (width, height) with pixel centres at whole numbers."""
    return Camera("PINHOLE", size[0], size[1], (*focal, centre[0] + 0.5, centre[1] + 0.5))


def pinhole_from_matrix(matrix: NDArray[np.float64], size: tuple[int, int]) -> Camera:
    """Return a PINHOLE camera from a calibration matrix, (3, 3) or (3, 4), with pixel centres at whole numbers."""
    check_calibration_matrix(matrix[:, :3])
    fx, fy, cx, cy = (float(matrix[index]) for index in ((0, 0), (1, 1), (0, 2), (1, 2)))
    return pinhole_from_opencv((fx, fy), (cx, cy), size)


def check_calibration_matrix(matrix: NDArray[np.float64]) -> None:
    """Raise `SequenceError` if a (3, 3) matrix is not one of focal lengths and a principal point alone."""
    focal = matrix[[0, 1], [0, 1]]
    others = matrix[[0, 1, 2, 2], [1, 0, 0, 1]]
    if not (np.isfinite(matrix).all() and (focal > 0).all() and abs(matrix[2, 2] - 1) <= _SKEW_TOLERANCE):
        raise SequenceError(
            "expected a calibration matrix [fx 0 cx; 0 fy cy; 0 0 1] with positive focal lengths, found another; "
            "check the file, or give the camera"
        )
    if np.abs(others).max() > _SKEW_TOLERANCE * focal.max():
        raise SequenceError(
            "expected a calibration matrix [fx 0 cx; 0 fy cy; 0 0 1], found one with skew, which no camera model has; "
            "check the file, or give the camera"
        )
