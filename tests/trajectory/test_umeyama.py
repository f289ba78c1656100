import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from gtf_tune.errors import TrajectoryError
from gtf_tune.trajectory.alignment import Similarity, umeyama

SEEDS = st.integers(0, 2**32 - 1)
SCALES = st.floats(-8, 8).map(lambda exponent: 10.0**exponent)


def cloud(seed: int, count: int = 30) -> np.ndarray:
    return np.random.default_rng(seed).normal(size=(count, 3))


def any_similarity(seed: int, scale: float) -> Similarity:
    rng = np.random.default_rng(seed)
    return Similarity(scale, Rotation.random(random_state=rng).as_matrix(), scale * rng.normal(size=3))


@given(SEEDS, SCALES)
def test_a_similarity_is_found_again_at_any_scale(seed, scale):
    points, made = cloud(seed), any_similarity(seed, scale)

    found = umeyama(points, made.apply(points))

    assert found.scale == pytest.approx(scale, rel=1e-12)
    np.testing.assert_allclose(found.rotation, made.rotation, atol=1e-12)
    np.testing.assert_allclose(found.translation, made.translation, atol=1e-12 * scale)


@given(SEEDS, SCALES)
def test_a_rigid_motion_is_found_again_at_any_scale(seed, size):
    points, made = size * cloud(seed), any_similarity(seed, 1.0)

    found = umeyama(points, made.apply(points), "se3")

    assert found.scale == 1.0
    np.testing.assert_allclose(found.rotation, made.rotation, atol=1e-6)
    np.testing.assert_allclose(found.apply(points), made.apply(points), atol=1e-12 * max(size, 1))


@given(SEEDS)
def test_rotations_are_proper_even_for_mirror_images(seed):
    points = cloud(seed)

    found = umeyama(points, points * [1, 1, -1])

    assert np.linalg.det(found.rotation) == pytest.approx(1.0)


@given(SEEDS, st.sampled_from(["sim3", "se3"]))
def test_no_nearby_similarity_is_better(seed, kind):
    rng = np.random.default_rng(seed)
    source, target = rng.normal(size=(2, 12, 3))
    found = umeyama(source, target, kind)
    best = ((found.apply(source) - target) ** 2).sum()

    for _ in range(20):
        turn = Rotation.from_rotvec(0.01 * rng.normal(size=3)).as_matrix()
        stretch = np.exp(0.01 * rng.normal()) if kind == "sim3" else 1.0
        other = Similarity(found.scale * stretch, turn @ found.rotation, found.translation + 0.01 * rng.normal(size=3))
        assert ((other.apply(source) - target) ** 2).sum() >= best * (1 - 1e-12)


def test_no_alignment_changes_nothing():
    found = umeyama(cloud(0), cloud(1), "none")

    np.testing.assert_array_equal(found.apply(cloud(0)), cloud(0))


@given(SEEDS, SCALES)
def test_inverse_undoes(seed, scale):
    points, made = cloud(seed), any_similarity(seed, scale)

    np.testing.assert_allclose(made.inverse().apply(made.apply(points)), points, atol=1e-11)


@pytest.mark.parametrize("kind", ["sim3", "se3", "none"])
@pytest.mark.parametrize("count", [0, 1, 3])
def test_too_few_points_are_refused(kind, count):
    with pytest.raises(TrajectoryError, match=f"at least 4 matched frames to compare trajectories, not {count}"):
        umeyama(cloud(0, count), cloud(1, count), kind)


@pytest.mark.parametrize("kind", ["sim3", "se3"])
@pytest.mark.parametrize("size", [1e-150, 1e-8, 1.0, 100.0, 1e8, 1e150])
def test_a_line_is_refused_at_any_scale_and_a_cloud_is_not(kind, size):
    line = size * np.linspace(0, 1, 20)[:, np.newaxis] * [1.0, 2.0, -0.3]

    with pytest.raises(TrajectoryError, match="first trajectory lie on a line or coincide"):
        umeyama(size * cloud(0, 20), line, kind)
    with pytest.raises(TrajectoryError, match="second trajectory lie on a line or coincide"):
        umeyama(line, size * cloud(0, 20), kind)
    umeyama(size * cloud(0, 20), size * cloud(0, 20), kind)


def test_a_line_far_from_the_origin_is_refused():
    line = 1e6 + np.linspace(0, 1, 20)[:, np.newaxis] * [1.0, 2.0, -0.3]

    with pytest.raises(TrajectoryError, match="first and the second trajectory lie on a line"):
        umeyama(line, line)


def test_a_line_with_six_digits_is_refused_and_a_straight_road_is_not():
    along = np.linspace(0, 1, 51)[:, np.newaxis] * [0.3, -0.2, 1.0]
    road = along + 0.0025 * np.sin(np.linspace(0, 6, 51))[:, np.newaxis] * [1.0, 0, 0]

    with pytest.raises(TrajectoryError, match="lie on a line"):
        umeyama(along.round(6), along.round(6))
    assert umeyama(road, road).scale == pytest.approx(1)


@pytest.mark.parametrize("point", [[0.0, 0, 0], [0.1, 0.7, -1e6]])
def test_coinciding_points_are_refused(point):
    with pytest.raises(TrajectoryError, match="coincide"):
        umeyama(np.tile(point, (20, 1)), cloud(0, 20))


def test_points_that_differ_by_their_rounding_only_are_refused():
    steps = np.random.default_rng(0).integers(-2, 3, size=(20, 3))

    with pytest.raises(TrajectoryError, match="coincide"):
        umeyama(1e6 + steps * np.spacing(1e6), cloud(0, 20))


@pytest.mark.parametrize("value", [np.nan, np.inf])
def test_points_that_are_not_finite_are_refused(value):
    broken = cloud(0)
    broken[3, 1] = value

    with pytest.raises(TrajectoryError, match="finite points"):
        umeyama(broken, cloud(0))


def test_shapes_must_agree():
    with pytest.raises(TrajectoryError, match=r"matched points of shape \(n, 3\), not \(5, 3\) and \(6, 3\)"):
        umeyama(cloud(0, 5), cloud(0, 6))


@pytest.mark.parametrize("kind", ["sim3", "se3"])
def test_unrelated_points_are_refused(kind):
    """Where the covariance has rank 1, every rotation about one axis fits equally well."""
    square = np.array([[1.0, 0, 0], [-1, 0, 0], [0, 1, 0], [0, -1, 0]])
    wedge = np.array([[1.0, 0, 0], [1, 0, 0], [-1, 1, 0], [-1, -1, 0]])

    with pytest.raises(TrajectoryError, match="no rotation of one trajectory fits"):
        umeyama(square, wedge, kind)


def test_a_rigid_motion_between_absurdly_different_sizes_is_refused():
    with pytest.raises(TrajectoryError, match="comparable size"):
        umeyama(1e250 * cloud(0), cloud(0), "se3")
