"""Measure what images hold that a pipeline can work with."""

from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from gtf_tune.sequence.camera import Camera
from gtf_tune.sequence.image_noise import GreyImage
from gtf_tune.sequence.images import sharpness

_ORB_FEATURES = 1000
_RATIO = 0.8
_RANSAC_PX = 2.0
_FEWEST_MATCHES = 20

# Where focal lengths are unknown, a phone's: 1.2 times the longer side.
_GUESSED_FOCAL = 1.2

# A homography K H K^-1 of a pure rotation has equal singular values; noise spreads them by a few thousandths.
_ROTATION_SPREAD = 0.01
_EXPLAINED_SHARE = 0.9

Points = NDArray[np.float32]


@dataclass(frozen=True)
class FrameContent:
    """Hold what one image offers: its sharpness, its number of corners, and its brightness in grey levels."""

    frame_id: int
    sharpness: float
    corners: int
    mean_grey: float


@dataclass(frozen=True)
class PairContent:
    """Hold how two successive images hang together.

    ``shift_px`` is the median distance that matched features move. ``rotation_only`` says that a turn of the camera
    explains the motion, so that the pair tells nothing of positions or depths. ``identical`` means equal pixels.
    """

    first: int
    second: int
    matches: int
    shift_px: float
    rotation_only: bool
    identical: bool


def frame_content(frame_id: int, grey: GreyImage) -> FrameContent:
    """Measure one image."""
    corners = cv2.FastFeatureDetector.create(20).detect(grey, None)
    return FrameContent(frame_id, sharpness(grey), len(corners), float(grey.mean()))


def pair_content(ids: tuple[int, int], first: GreyImage, second: GreyImage, camera: Camera | None) -> PairContent:
    """Measure two successive images with these frame ids, by ORB features and one homography."""
    if np.array_equal(first, second):
        return PairContent(*ids, matches=0, shift_px=0.0, rotation_only=False, identical=True)
    a, b = _match(first, second)
    if len(a) < _FEWEST_MATCHES:
        return PairContent(*ids, matches=len(a), shift_px=float("nan"), rotation_only=False, identical=False)
    homography, inliers = cv2.findHomography(a, b, cv2.RANSAC, _RANSAC_PX)
    turned = homography is not None and inliers.mean() > _EXPLAINED_SHARE and _is_rotation(homography, first, camera)
    shift = float(np.median(np.linalg.norm(b - a, axis=1)))
    return PairContent(*ids, matches=len(a), shift_px=shift, rotation_only=turned, identical=False)


def _match(first: GreyImage, second: GreyImage) -> tuple[Points, Points]:
    """Return matched points (n, 2) in pixels."""
    orb = cv2.ORB.create(_ORB_FEATURES)
    (points_a, found_a), (points_b, found_b) = (orb.detectAndCompute(grey, None) for grey in (first, second))
    if found_a is None or found_b is None or len(found_b) < 2:
        return np.empty((0, 2), np.float32), np.empty((0, 2), np.float32)
    pairs = cv2.BFMatcher(cv2.NORM_HAMMING).knnMatch(found_a, found_b, k=2)
    good = [best for best, other in pairs if best.distance < _RATIO * other.distance]
    a = np.array([points_a[match.queryIdx].pt for match in good], np.float32).reshape(-1, 2)
    b = np.array([points_b[match.trainIdx].pt for match in good], np.float32).reshape(-1, 2)
    return a, b


def _is_rotation(homography: NDArray[np.float64], grey: GreyImage, camera: Camera | None) -> bool:
    height, width = grey.shape
    focal = (_GUESSED_FOCAL * max(width, height),) * 2
    centre = (width / 2, height / 2)
    if camera is not None and "cx" in camera.param_names:
        values = dict(zip(camera.param_names, camera.params, strict=True))
        focal = (values.get("fx", values.get("f", focal[0])), values.get("fy", values.get("f", focal[1])))
        centre = (values["cx"] - 0.5, values["cy"] - 0.5)
    intrinsics = np.array([[focal[0], 0, centre[0]], [0, focal[1], centre[1]], [0, 0, 1]])
    largest, _, smallest = np.linalg.svd(np.linalg.inv(intrinsics) @ homography @ intrinsics, compute_uv=False)
    return bool(largest / smallest - 1 < _ROTATION_SPREAD)
