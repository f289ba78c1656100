"""Turn a pinhole and the distortion that robotics calls it by into one of COLMAP's models."""

from gtf_tune.errors import SequenceError
from gtf_tune.sequence.camera import Camera
from gtf_tune.sequence.layouts.base import GIVE_THE_CAMERA

_RADTAN = frozenset(
    [
        "radial-tangential",
        "radial_tangential",
        "radtan",
        "radtan4",
        "radtan5",
        "radtan8",
        "plumb_bob",
        "rational_polynomial",
        "rational",
        "brown",
        "brown_conrady",
        "opencv",
    ]
)
_EQUIDISTANT = frozenset(["equidistant", "equi", "equid4", "fisheye", "kannala_brandt", "kannala-brandt", "kb4", "kb"])
_FOV = frozenset({"fov", "fov1", "atan"})
_NONE = frozenset({"none", "null", "no", "undistorted", ""})
_RADTAN_COUNTS = (4, 5, 8)


def is_distortion(kind: str) -> bool:
    """Return True if a distortion of this name is known."""
    return kind.lower() in _RADTAN | _EQUIDISTANT | _FOV


def distorted_pinhole(
    kind: str, coefficients: list[float], focal_centre: tuple[float, ...], size: tuple[int, int]
) -> Camera:
    """Return the camera of a pinhole with distortion, whose pixel centres are at whole numbers as in OpenCV.

    Parameters
    ----------
    kind
        What the file calls the distortion, such as ``radtan`` or ``equidistant``.
    coefficients
        In OpenCV's order: k1, k2, p1, p2, k3, k4, k5, k6 of ``radtan`` (4, 5 or 8), k1 to k4 of ``equidistant``.
    focal_centre
        fx, fy, cx, cy in pixels.
    size
        (width, height) in pixels.

    Raises
    ------
    SequenceError
        The distortion is none that COLMAP has a model for, or takes another number of coefficients.
    """
    fx, fy, cx, cy = focal_centre
    pinhole = (fx, fy, cx + 0.5, cy + 0.5)
    name, count = kind.lower(), len(coefficients)
    if name in _NONE and not any(coefficients):
        return Camera("PINHOLE", *size, pinhole)
    if name in _RADTAN and count in _RADTAN_COUNTS:
        padded = (*coefficients, 0.0, 0.0, 0.0, 0.0)[:8]
        model = "FULL_OPENCV" if any(padded[4:]) else "OPENCV"
        return Camera(model, *size, (*pinhole, *(padded if any(padded[4:]) else padded[:4])))
    if name in _EQUIDISTANT and count == 4:
        return Camera("OPENCV_FISHEYE", *size, (*pinhole, *coefficients))
    if name in _FOV and count == 1:
        return Camera("FOV", *size, (*pinhole, *coefficients))
    raise SequenceError(
        "expected a distortion_model among radtan with 4, 5 or 8 coefficients, equidistant with 4, fov with 1 and "
        f"none, found '{kind[:40]}' with {count}; {GIVE_THE_CAMERA}"
    )
