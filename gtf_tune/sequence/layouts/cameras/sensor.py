"""Turn the keys of EuRoC's sensor.yaml, which Kalibr's are akin to, into one of COLMAP's models."""

from gtf_tune.errors import SequenceError
from gtf_tune.sequence.camera import Camera
from gtf_tune.sequence.distortion import distorted_pinhole
from gtf_tune.sequence.layouts.base import GIVE_THE_CAMERA
from gtf_tune.sequence.layouts.fields import Field


def sensor_camera(values: Field) -> Camera:
    """Return the camera of a sensor.yaml, or of one camera in Kalibr's chain, which has other names for some keys."""
    width, height = values["resolution"].counts(2)
    kind = values["camera_model"].text().lower() if "camera_model" in values else "pinhole"
    given = values.first("distortion_coefficients", "distortion_coeffs")
    coefficients = given.numbers(*range(9)) if given else []
    if kind == "eucm" and not any(coefficients):
        alpha, beta, fx, fy, cx, cy = values["intrinsics"].numbers(6)
        return Camera("EUCM", width, height, (fx, fy, cx + 0.5, cy + 0.5, alpha, beta))
    if kind != "pinhole":
        raise SequenceError(f"expected camera_model pinhole or eucm, found '{kind[:40]}'; {GIVE_THE_CAMERA}")
    named = values["distortion_model"].text() if "distortion_model" in values else "none"
    pinhole = tuple(values["intrinsics"].numbers(4))
    return distorted_pinhole(named, coefficients, pinhole, (width, height))
