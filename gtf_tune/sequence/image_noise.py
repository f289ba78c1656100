"""Add Gaussian noise to images, the same on every machine and in every order.

The noise of a frame comes from a counter-based generator keyed by (seed, frame id) alone, so it depends neither on the
frames drawn before it nor on the number of threads.
"""

import math

import numpy as np
from numpy.typing import NDArray

GreyImage = NDArray[np.uint8]
ColourImage = NDArray[np.uint8]

NOISE_VERSION = "philox-float32-1"
"""Name of the noise algorithm; it is part of every key of noisy images and changes whenever their pixels would."""

_GREY_MAX = 255.0


def noisy_image(pixels: NDArray[np.uint8], sigma: float, *, seed: int, frame_id: int) -> NDArray[np.uint8]:
    """Return the image plus Gaussian noise, rounded to the nearest grey level and clipped to 0..255.

    This is the paper's I + N(0, sigma) (algorithm "GTF"), quantised as a camera would; each
    channel of a colour image has noise of its own.

    Parameters
    ----------
    pixels
        Image of shape (h, w) or (h, w, 3).
    sigma
        Standard deviation of the noise in grey levels, finite and at least 0. With 0 the input itself is returned.
    seed, frame_id
        Non-negative 64-bit numbers that key the generator. Philox with a key of its own per frame gives independent
        streams (Salmon et al., "Parallel random numbers: as easy as 1, 2, 3", SC 2011).

    Raises
    ------
    ValueError
        A number is outside its range, or the image is neither 8-bit grey nor 8-bit colour.
    """
    _check(pixels, sigma)
    if sigma == 0:
        return pixels
    generator = np.random.Generator(np.random.Philox(key=np.array([seed, frame_id], dtype=np.uint64)))
    noise = generator.standard_normal(pixels.shape, dtype=np.float32)
    noise *= np.float32(sigma)
    noise += pixels
    np.rint(noise, out=noise)
    np.clip(noise, 0.0, _GREY_MAX, out=noise)
    return noise.astype(np.uint8)


def _check(pixels: NDArray[np.uint8], sigma: float) -> None:
    if pixels.dtype != np.uint8 or not (pixels.ndim == 2 or (pixels.ndim == 3 and pixels.shape[2] == 3)):
        raise ValueError(
            f"expected an 8-bit image of shape (h, w) or (h, w, 3), not {pixels.dtype} of shape {pixels.shape}"
        )
    if not (math.isfinite(sigma) and sigma >= 0):
        raise ValueError(f"sigma must be a finite number of grey levels of at least 0, not {sigma!r}")
