import cv2
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from gtf_tune.errors import SequenceError
from gtf_tune.sequence import MODEL_PARAMS, Camera, pinhole_from_opencv

PINHOLE = Camera("PINHOLE", 640, 480, (500.0, 510.0, 320.5, 240.5))


def test_opencv_numbers_move_by_half_a_pixel():
    camera = pinhole_from_opencv((500, 510), (320, 240), (640, 480))

    assert camera == PINHOLE


@pytest.mark.parametrize("model", MODEL_PARAMS)
def test_every_colmap_model_is_known_with_its_number_of_parameters(model):
    pycolmap = pytest.importorskip("pycolmap")
    names = MODEL_PARAMS[model].split()

    camera = pycolmap.Camera(model=model, width=640, height=480, params=[1.0] * len(names))

    assert camera.params_info.replace(" ", "").split(",") == names
    assert int(camera.model) == list(MODEL_PARAMS).index(model)


@given(factor=st.integers(2, 6), u=st.floats(0, 60), v=st.floats(0, 40))
def test_scaling_maps_image_points_as_resizing_by_areas_does(factor, u, v):
    small = Camera("PINHOLE", 60, 40, (50.0, 55.0, 31.0, 19.0))
    large = small.scaled(60 * factor, 40 * factor)
    fx, fy, cx, cy = large.params
    ray = ((u - 31.0) / 50.0, (v - 19.0) / 55.0)

    assert np.allclose([fx * ray[0] + cx, fy * ray[1] + cy], [u * factor, v * factor])


def test_scaling_agrees_with_where_opencv_puts_a_blob():
    grey = np.zeros((480, 640), np.uint8)
    cv2.circle(grey, (411, 123), 30, 255, -1)
    small = cv2.resize(grey, (160, 120), interpolation=cv2.INTER_AREA).astype(float)
    camera = Camera("PINHOLE", 640, 480, (500.0, 500.0, 411.5, 123.5)).scaled(160, 120)

    rows, columns = np.mgrid[:120, :160] + 0.5
    centre = ((small * columns).sum() / small.sum(), (small * rows).sum() / small.sum())

    assert camera.params[2:] == pytest.approx(centre, abs=0.02)


def test_one_focal_length_scales_by_the_mean_and_distortion_stays():
    camera = Camera("RADIAL", 100, 50, (80.0, 50.0, 25.0, -0.1, 0.02)).scaled(50, 30)

    assert camera.params == pytest.approx((80 * 0.55, 25, 15, -0.1, 0.02))


def test_key_follows_the_last_bit_of_a_parameter():
    other = Camera("PINHOLE", 640, 480, (np.nextafter(500.0, 501), 510.0, 320.5, 240.5))

    assert PINHOLE.key == Camera("PINHOLE", 640, 480, (500, 510, 320.5, 240.5)).key
    assert PINHOLE.key != other.key


def test_intrinsics_of_another_resolution_fit_and_of_another_shape_do_not():
    assert PINHOLE.fitted(320, 240) == PINHOLE.scaled(320, 240)
    with pytest.raises(SequenceError, match="640x480 images, but the images are 640x360"):
        PINHOLE.fitted(640, 360)


@pytest.mark.parametrize(
    ("model", "size", "params", "message"),
    [
        ("PINHOL", (640, 480), (1, 1, 1, 1), "unknown camera model 'PINHOL'"),
        ("PINHOLE", (640, 480), (1, 1, 1), "takes 4 parameters"),
        ("PINHOLE", (640, 0), (1, 1, 1, 1), "image size of 1 to"),
        ("PINHOLE", (640, 480), (1, -1, 1, 1), "fy of PINHOLE cannot be -1"),
        ("PINHOLE", (640, 480), (1, 1, float("nan"), 1), "cx of PINHOLE cannot be nan"),
    ],
)
def test_impossible_intrinsics_are_refused(model, size, params, message):
    with pytest.raises(SequenceError, match=message):
        Camera(model, *size, params)


@pytest.mark.parametrize("size", [(1920, 1088), (1920, 1072), (1912, 1080), (1080, 1920), (960, 600)])
def test_intrinsics_of_cropped_padded_or_turned_images_are_refused(size):
    camera = Camera("PINHOLE", 1920, 1080, (1500, 1500, 960, 540))

    with pytest.raises(SequenceError, match="another shape: cropped, padded or turned"):
        camera.fitted(*size)


@pytest.mark.parametrize("size", [(960, 540), (640, 364), (1921, 1080), (3840, 2160)])
def test_intrinsics_of_resized_images_are_scaled(size):
    camera = Camera("PINHOLE", 1920, 1080, (1500, 1500, 960, 540)).fitted(*size)

    assert (camera.width, camera.height) == size
    assert camera.params[2:] == (size[0] / 2, size[1] / 2)
