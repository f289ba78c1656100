"""Find pairs of images between which the camera only turned, also where its focal length is unknown."""

from collections.abc import Sequence as Items

import numpy as np
from numpy.typing import NDArray

from gtf_tune.sequence.camera import Camera

# A homography K H K^-1 of a pure rotation has equal singular values; noise spreads them by a few thousandths, and by
# more where the camera turns far. That is believed only where nearly all pairs of a sequence look like turns.
_SPREAD = 0.01
_SPREAD_AMONG_TURNS = 0.025
_USUAL_SHARE = 0.5

# Focal lengths tried where none is known, in units of the longer side: from wide angles to long lenses.
_FOCALS = np.geomspace(0.35, 3.5, 70)

Homographies = Items[NDArray[np.float64] | None]


def turning_pairs(homographies: Homographies, size: tuple[int, int], camera: Camera | None) -> list[bool]:
    """Return for each pair whether a turn of the camera explains it.

    Parameters
    ----------
    homographies
        (3, 3) for each pair, in pixels with centres at whole numbers; ``None`` where none explains the motion.
    size
        (width, height) of the images in pixels.
    camera
        Intrinsics. Where they are unknown, one focal length is fitted to all pairs: a pure rotation determines it. Of a
        camera that moves in front of a plane it would be infinite, so a best focal length at the end of the range is
        none.
    """
    explained = [homography for homography in homographies if homography is not None]
    if not explained:
        return [False] * len(homographies)
    spreads = _spreads(np.array(explained), _intrinsics(size, camera))
    best = int(np.argmin(np.median(spreads, axis=1)))
    fitted = len(spreads) > 1
    found = spreads[best]
    usual = len(explained) >= _USUAL_SHARE * len(homographies) and np.median(found) < _SPREAD
    limit = _SPREAD_AMONG_TURNS if fitted and usual and len(explained) > 1 else _SPREAD
    turned = iter((found < limit) & (not fitted or best < len(spreads) - 1))
    return [homography is not None and bool(next(turned)) for homography in homographies]


def _intrinsics(size: tuple[int, int], camera: Camera | None) -> NDArray[np.float64]:
    """Return the calibration matrices to try, (n, 3, 3)."""
    if camera is not None and "cx" in camera.param_names:
        values = dict(zip(camera.param_names, camera.params, strict=True))
        focal = [(values.get("fx", values.get("f", 0.0)), values.get("fy", values.get("f", 0.0)))]
        centre = (values["cx"] - 0.5, values["cy"] - 0.5)
    else:
        focal = [(max(size) * factor, max(size) * factor) for factor in _FOCALS.tolist()]
        centre = ((size[0] - 1) / 2, (size[1] - 1) / 2)
    return np.array([[[fx, 0, centre[0]], [0, fy, centre[1]], [0, 0, 1]] for fx, fy in focal])


def _spreads(homographies: NDArray[np.float64], intrinsics: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return largest over smallest singular value of K^-1 H K minus 1, (number of K, number of H)."""
    inverse = np.linalg.inv(intrinsics)
    values = np.linalg.svd(inverse[:, None] @ homographies[None] @ intrinsics[:, None], compute_uv=False)
    spreads: NDArray[np.float64] = values[..., 0] / np.maximum(values[..., 2], np.finfo(float).tiny) - 1
    return spreads
