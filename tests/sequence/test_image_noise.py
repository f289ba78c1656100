import hashlib
from concurrent.futures import ThreadPoolExecutor

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from gtf_tune.sequence.image_noise import noisy_image

GREY = np.full((48, 64), 128, dtype=np.uint8)


def test_noise_has_the_same_pixels_on_every_machine():
    ramp = np.arange(48 * 64, dtype=np.uint16).reshape(48, 64).astype(np.uint8)

    noisy = noisy_image(ramp, 5.0, seed=7, frame_id=3)

    assert (
        hashlib.sha256(noisy.tobytes()).hexdigest()
        == "68e5cc07224eb31cf1a794777bb29bf6322f96a08ff31fe94ddcaa850148d4aa"
    )


def test_zero_sigma_returns_the_input():
    assert noisy_image(GREY, 0.0, seed=1, frame_id=2) is GREY


def test_input_is_left_as_it_was():
    before = GREY.copy()

    noisy_image(GREY, 10.0, seed=1, frame_id=2)

    np.testing.assert_array_equal(GREY, before)


def test_order_and_threads_do_not_change_a_frame():
    frames = list(range(16))
    in_order = [noisy_image(GREY, 5.0, seed=1, frame_id=frame) for frame in frames]

    with ThreadPoolExecutor(4) as pool:
        shuffled = list(pool.map(lambda frame: noisy_image(GREY, 5.0, seed=1, frame_id=frame), reversed(frames)))

    np.testing.assert_array_equal(in_order, shuffled[::-1])


def test_noise_has_the_asked_mean_and_deviation():
    grey = np.full((600, 800), 128, dtype=np.uint8)

    difference = noisy_image(grey, 5.0, seed=1, frame_id=0).astype(float) - grey

    assert abs(difference.mean()) < 4 * 5.0 / np.sqrt(grey.size)
    # Rounding to whole grey levels adds the variance 1/12 (Sheppard).
    assert difference.std() == pytest.approx(np.sqrt(25 + 1 / 12), rel=0.005)


def test_values_are_clipped_not_wrapped():
    black, white = np.zeros((100, 100), np.uint8), np.full((100, 100), 255, np.uint8)

    assert noisy_image(black, 20.0, seed=0, frame_id=0).max() < 128
    assert noisy_image(white, 20.0, seed=0, frame_id=0).min() > 127


def test_values_are_rounded_not_truncated():
    large = np.full((1000, 1000), 100, np.uint8)

    shares = np.bincount(noisy_image(large, 0.2, seed=3, frame_id=0).ravel(), minlength=256) / large.size

    # P(|N(0, 0.2)| > 0.5) / 2 = 0.0062 on either side.
    assert shares[99] == pytest.approx(0.0062, rel=0.1)
    assert shares[101] == pytest.approx(0.0062, rel=0.1)


@given(seed=st.integers(0, 2**63), frame_id=st.integers(0, 2**40))
def test_neighbouring_keys_give_uncorrelated_noise(seed, frame_id):
    first = noisy_image(GREY, 10.0, seed=seed, frame_id=frame_id).astype(float).ravel() - 128
    others = [
        noisy_image(GREY, 10.0, seed=seed + 1, frame_id=frame_id),
        noisy_image(GREY, 10.0, seed=seed, frame_id=frame_id + 1),
    ]

    for other in others:
        assert abs(np.corrcoef(first, other.astype(float).ravel() - 128)[0, 1]) < 0.12


@pytest.mark.parametrize("sigma", [-1.0, float("nan"), float("inf")])
def test_impossible_sigma_is_refused(sigma):
    with pytest.raises(ValueError, match="sigma"):
        noisy_image(GREY, sigma, seed=0, frame_id=0)


@pytest.mark.parametrize("image", [np.zeros((4, 4, 2), np.uint8), np.zeros((4, 4), np.uint16)])
def test_anything_but_8_bit_grey_or_colour_is_refused(image):
    with pytest.raises(ValueError, match="8-bit image"):
        noisy_image(image, 1.0, seed=0, frame_id=0)
