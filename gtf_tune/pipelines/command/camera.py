"""Give programs the intrinsics of a camera in the form that they know."""

from collections.abc import Mapping

from gtf_tune.pipelines.command.templates import Value
from gtf_tune.sequence import Camera

DISTORTION = ("k1", "k2", "p1", "p2", "k3", "k4", "k5", "k6")
"""Coefficients of OpenCV's radial-tangential model, in OpenCV's order."""

_OPENCV_MODELS = frozenset({"SIMPLE_PINHOLE", "PINHOLE", "SIMPLE_RADIAL", "RADIAL", "OPENCV", "FULL_OPENCV"})
_PIXEL_CENTRE = 0.5
_SHORT, _MIDDLE = 4, 5


def camera_values(camera: Camera) -> dict[str, Value]:
    """Return the placeholders of a camera: COLMAP's, and OpenCV's where the model is one of OpenCV's.

    COLMAP's parameters have pixel centres at +0.5, OpenCV's at whole numbers.
    """
    values: dict[str, Value] = {
        "camera_model": camera.model,
        "camera_params": ",".join(repr(value) for value in camera.params),
    }
    return values | {f"camera_{name}": value for name, value in opencv_camera(camera).items()}


def opencv_camera(camera: Camera) -> Mapping[str, float | str]:
    """Return fx, fy, cx, cy, all coefficients, and as one text those that matter; nothing for other models."""
    if camera.model not in _OPENCV_MODELS:
        return {}
    params = dict(zip(camera.param_names, camera.params, strict=True))
    coefficients = [params.get(name, params.get("k", 0.0) if name == "k1" else 0.0) for name in DISTORTION]
    return {
        "fx": params.get("fx", params.get("f", 0.0)),
        "fy": params.get("fy", params.get("f", 0.0)),
        "cx": params["cx"] - _PIXEL_CENTRE,
        "cy": params["cy"] - _PIXEL_CENTRE,
        **dict(zip(DISTORTION, coefficients, strict=True)),
        "distortion": " ".join(repr(value) for value in _shortened(coefficients)),
    }


def _shortened(coefficients: list[float]) -> list[float]:
    """Return as many coefficients as OpenCV needs to be given: none, 4, 5 or 8."""
    if not any(coefficients):
        return []
    if not any(coefficients[_SHORT:]):
        return coefficients[:_SHORT]
    return coefficients if any(coefficients[_MIDDLE:]) else coefficients[:_MIDDLE]
