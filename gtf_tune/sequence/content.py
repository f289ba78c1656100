"""Measure what images offer to a pipeline."""

from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from gtf_tune.sequence.image_noise import GreyImage
from gtf_tune.sequence.images import sharpness

_ORB_FEATURES = 1000
_RATIO = 0.8
_RANSAC_PX = 2.0
_FEWEST_MATCHES = 20

_EXPLAINED_SHARE = 0.9

Points = NDArray[np.float32]


@dataclass(frozen=True)
class FrameContent:
    """What one image offers: its sharpness, its number of corners, and its brightness in grey levels."""

    frame_id: int
    sharpness: float
    corners: int
    mean_grey: float


@dataclass(frozen=True, eq=False)
class PairContent:
    """How two successive images hang together.

    ``shift_px`` is the median distance that matched features move. ``homography``, (3, 3) in pixels, is there where one
    explains the motion, as it does where the camera only turns. ``identical`` means equal pixels.
    """

    first: int
    second: int
    matches: int
    shift_px: float = float("nan")
    homography: NDArray[np.float64] | None = None
    identical: bool = False


def frame_content(frame_id: int, grey: GreyImage) -> FrameContent:
    """Measure one image."""
    corners = cv2.FastFeatureDetector.create(20).detect(grey, None)
    return FrameContent(frame_id, sharpness(grey), len(corners), float(grey.mean()))


def pair_content(ids: tuple[int, int], first: GreyImage, second: GreyImage) -> PairContent:
    """Measure two successive images with these frame ids, by ORB features and one homography."""
    if np.array_equal(first, second):
        return PairContent(*ids, matches=0, shift_px=0.0, identical=True)
    a, b = match_features(first, second)
    if len(a) < _FEWEST_MATCHES:
        return PairContent(*ids, matches=len(a))
    homography, inliers = cv2.findHomography(a, b, cv2.RANSAC, _RANSAC_PX)
    explains = homography is not None and inliers.mean() > _EXPLAINED_SHARE
    shift = float(np.median(np.linalg.norm(b - a, axis=1)))
    return PairContent(*ids, matches=len(a), shift_px=shift, homography=homography if explains else None)


def match_features(first: GreyImage, second: GreyImage) -> tuple[Points, Points]:
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
