import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from gtf_tune.sequence import Camera
from gtf_tune.sequence.render.raster import build_atlas, draw
from gtf_tune.sequence.render.scene import Face

CAMERA = Camera("PINHOLE", 160, 120, (130.0, 130.0, 80.0, 60.0))


def _board(depth, texture, size=4.0):
    """A square board that faces a camera at the origin, at the given depth."""
    half = size / 2
    edges = np.array((size, 0, 0)), np.array((0, size, 0))
    return Face(np.array((-half, -half, depth)), *edges, texture.astype(np.float32))


def _even(grey):
    return np.full((64, 64), grey)


def _pose(rotvec=(0, 0, 0), position=(0, 0, 0)):
    pose = np.eye(4)
    pose[:3, :3] = Rotation.from_rotvec(rotvec).as_matrix()
    pose[:3, 3] = position
    return pose


def _image(faces, pose=None, camera=CAMERA):
    return draw(tuple(faces), build_atlas(tuple(faces)), camera, _pose() if pose is None else pose)


@settings(max_examples=25, deadline=None)
@given(
    tilt=st.tuples(*[st.floats(-0.25, 0.25)] * 3),
    position=st.tuples(*[st.floats(-0.3, 0.3)] * 3),
)
def test_a_dot_appears_where_the_camera_model_projects_it(tilt, position):
    rows, columns = np.mgrid[:512, :512]
    texture = 255 * np.exp(-((columns - 280) ** 2 + (rows - 230) ** 2) / (2 * 3.5**2))
    pose = _pose(tilt, position)

    image = _image([_board(3.0, texture)], pose).astype(float)

    point = np.array([(280.5 / 512 - 0.5) * 4, (230.5 / 512 - 0.5) * 4, 3.0])
    x, y, z = pose[:3, :3].T @ (point - pose[:3, 3])
    rows, columns = np.mgrid[:120, :160] + 0.5
    centroid = (image * columns).sum() / image.sum(), (image * rows).sum() / image.sum()
    # The centre of an ellipse is not quite the image of the centre of the circle.
    assert centroid == pytest.approx((130 * x / z + 80, 130 * y / z + 60), abs=0.03)


def test_near_faces_hide_far_ones_in_any_order():
    far, near = _board(3.0, _even(50)), _board(2.0, _even(200), size=1.0)

    for faces in ([far, near], [near, far]):
        image = _image(faces)
        assert image[60, 80] == pytest.approx(200)
        assert image[10, 10] == pytest.approx(50)


def test_faces_behind_the_camera_and_seen_edge_on_are_invisible():
    behind = _board(-1.0, _even(200))
    edge_on = Face(np.array((0.0, -1, 1)), np.array((0.0, 0, 2)), np.array((0.0, 2, 0)), _even(200).astype(np.float32))

    assert _image([behind, edge_on]).max() == 0


def test_a_face_that_passes_the_camera_is_drawn_in_front_of_it_only():
    floor = Face(np.array((-5.0, 1, -5)), np.array((10.0, 0, 0)), np.array((0.0, 0, 10)), _even(90).astype(np.float32))

    image = _image([floor])

    assert image[:60].max() == 0
    assert image[90:].min() == pytest.approx(90)


def test_detail_finer_than_the_pixels_becomes_even_grey():
    checker = np.indices((2048, 2048)).sum(axis=0) % 2 * 255

    image = _image([_board(3.0, checker)])

    assert np.abs(image[20:100, 20:140] - 127.5).max() < 2


def test_detail_coarser_than_the_pixels_keeps_its_contrast():
    stripes = np.tile((np.arange(256) // 16 % 2 * 255), (256, 1))

    image = _image([_board(3.0, stripes)])

    assert np.percentile(image[60], [5, 95]) == pytest.approx([0, 255], abs=10)
