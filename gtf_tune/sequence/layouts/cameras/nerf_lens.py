"""Turn the camera keys of transforms.json into one of COLMAP's models.

instant-ngp and nerfstudio share most keys. Principal points come from COLMAP and so have its pixel centres. ``k3``
belongs to the sixth power of the radius for perspective and fisheye lenses alike; ``k4`` to ``k6`` of a perspective
lens are the denominator of OpenCV's rational model, but ``k4`` alone may also be meant for the eighth power.
"""

import math
from collections.abc import Mapping

from gtf_tune.errors import SequenceError
from gtf_tune.sequence.camera import MODEL_PARAMS, Camera
from gtf_tune.sequence.layouts.base import GIVE_THE_CAMERA, naming
from gtf_tune.sequence.layouts.fields import Field

_COEFFICIENTS = tuple(
    [
        "k",
        "k0",
        "k1",
        "k2",
        "k3",
        "k4",
        "k5",
        "k6",
        "p0",
        "p1",
        "p2",
        "s0",
        "s1",
        "s2",
        "s3",
        "sx1",
        "sy1",
        "omega",
        "alpha",
        "beta",
    ]
)
CAMERA_KEYS = frozenset(
    [
        "camera_model",
        "is_fisheye",
        "w",
        "h",
        "fl_x",
        "fl_y",
        "cx",
        "cy",
        "camera_angle_x",
        "camera_angle_y",
        "x_fov",
        "y_fov",
        "distortion_params",
    ]
) | set(_COEFFICIENTS)

# Lenses of instant-ngp that no model of COLMAP describes, by the keys that choose them; and a shutter that none does.
_OTHER_LENSES = ("ftheta_p0", "latlong", "equirectangular", "orthographic", "rolling_shutter")

_PERSPECTIVE = frozenset(
    {"", "PERSPECTIVE", "SIMPLE_PINHOLE", "PINHOLE", "SIMPLE_RADIAL", "RADIAL", "OPENCV", "FULL_OPENCV"}
)
_FISHEYE = frozenset({"EQUIDISTANT", "KANNALA_BRANDT", "KB4"}) | {
    name for name in MODEL_PARAMS if name.endswith("FISHEYE") and not name.startswith("RAD_TAN")
}
_PERSPECTIVE_LADDER = ("OPENCV", "FULL_OPENCV")
_FISHEYE_LADDER = ("OPENCV_FISHEYE", "THIN_PRISM_FISHEYE")
_ONLY_RATIONAL = frozenset({"k5", "k6"})

_PANORAMA_ASPECT = 2.0
_ASPECT_TOLERANCE = 0.01


def lens_camera(values: Field, size: tuple[int, int]) -> Camera:
    """Return the intrinsics that the keys of a frame describe, for images of this (width, height) unless they say so.

    Raises
    ------
    SequenceError
        A value is wrong, no focal length is given, or no model of COLMAP describes the lens.
    """
    width, height = (values[key].count() if key in values else side for key, side in zip("wh", size, strict=True))
    name = values["camera_model"].text().upper() if "camera_model" in values else ""
    other = next((key for key in _OTHER_LENSES if _is_set(values, key)), None)
    if other:
        raise _unsupported(values, f"a camera described by '{other}'")
    with naming(values.path):
        if name == "EQUIRECTANGULAR":
            return _panorama(values, width, height)
        pinhole = _pinhole(values, width, height)
        if name == "FISHEYE624":
            coefficients = values["distortion_params"].numbers(12)
            return Camera("RAD_TAN_THIN_PRISM_FISHEYE", width, height, (*pinhole.values(), *coefficients))
        return _distorted(values, name, pinhole, (width, height))


def _is_set(values: Field, key: str) -> bool:
    """Return whether a key is there and is neither false nor zero."""
    return key in values and values[key].value not in (False, 0, None, [], [0, 0, 0, 0])


def _panorama(values: Field, width: int, height: int) -> Camera:
    if abs(width / height / _PANORAMA_ASPECT - 1) > _ASPECT_TOLERANCE:
        raise _unsupported(values, f"an equirectangular camera whose images are {width}x{height}, not twice as wide")
    return Camera("EQUIRECTANGULAR", width, height, (width, height))


def _pinhole(values: Field, width: int, height: int) -> dict[str, float]:
    across = _focal(values, ("fl_x", "camera_angle_x", "x_fov"), width)
    down = _focal(values, ("fl_y", "camera_angle_y", "y_fov"), height)
    if across is None and down is None:
        raise SequenceError(
            f"{values.path}: expected fl_x or camera_angle_x, found neither nor fl_y; {GIVE_THE_CAMERA}"
        )
    return {
        "fx": across if across is not None else down or 0.0,
        "fy": down if down is not None else across or 0.0,
        "cx": values["cx"].number() if "cx" in values else width / 2,
        "cy": values["cy"].number() if "cy" in values else height / 2,
    }


def _focal(values: Field, keys: tuple[str, str, str], side: int) -> float | None:
    """Return the focal length in pixels from the first key that is there: in pixels, radians or degrees."""
    pixels, radians, degrees = keys
    if pixels in values:
        return values[pixels].number()
    angle = values.first(radians, degrees)
    if angle is None:
        return None
    half = (angle.number() if radians in values else math.radians(angle.number())) / 2
    if not 0 < half < math.pi / 2:
        raise angle.fault("an angle between 0 and 180 degrees")
    return side / (2 * math.tan(half))


def _distorted(values: Field, name: str, pinhole: dict[str, float], size: tuple[int, int]) -> Camera:
    if "distortion_params" in values:
        raise _unsupported(values, "distortion_params of a camera_model other than FISHEYE624")
    given = {key: values[key].number() for key in _COEFFICIENTS if key in values}
    model = _model(values, name, given, square=pinhole["fx"] == pinhole["fy"])
    params = {**pinhole, "f": pinhole["fx"], **given}
    params["k"] = given.get("k") or given.get("k1", 0.0)
    return Camera(model, *size, tuple(params.get(param, 0.0) for param in MODEL_PARAMS[model].split()))


def _model(values: Field, name: str, given: Mapping[str, float], *, square: bool) -> str:
    """Return the model that the file names where it holds all coefficients, or the smallest that does."""
    used = {key for key, value in given.items() if value}
    fisheye = name in _FISHEYE or ("is_fisheye" in values and values["is_fisheye"].flag())
    if not fisheye and name in MODEL_PARAMS and name not in _PERSPECTIVE:
        missing = set(MODEL_PARAMS[name].split()) - set(given) - {"f", "fx", "fy", "cx", "cy"}
        if missing or not _holds(name, used, square):
            raise _unsupported(values, f"camera_model {name} with these coefficients")
        return name
    if not fisheye and name not in _PERSPECTIVE:
        raise _unsupported(values, f"camera_model {name}")
    if not fisheye and not used:
        return "PINHOLE"
    if not fisheye and "k4" in used and not used & _ONLY_RATIONAL and name != "FULL_OPENCV":
        raise _unsupported(values, "k4 of a perspective lens, which means different things in different programs")
    named = (name,) if name in MODEL_PARAMS and (name in _FISHEYE) == fisheye else ()
    for model in named + (_FISHEYE_LADDER if fisheye else _PERSPECTIVE_LADDER):
        if _holds(model, used, square):
            return model
    raise _unsupported(values, f"a lens with the coefficients {', '.join(sorted(used))}")


def _holds(model: str, used: set[str], square: bool) -> bool:
    """Return whether a model has these coefficients, and both focal lengths unless they are equal."""
    params = set(MODEL_PARAMS[model].split())
    return used <= params | ({"k1"} if "k" in params else set()) and (square or "f" not in params)


def _unsupported(values: Field, what: str) -> SequenceError:
    return SequenceError(f"{values.path}: expected a lens that COLMAP has a model for, found {what}; {GIVE_THE_CAMERA}")
