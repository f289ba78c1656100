from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from gtf_tune.metrics import AteSettings, RpeSettings, associated_matrix, ate, pairwise_matrix, rpe
from gtf_tune.trajectory import Trajectory, associate_by_frame_id
from gtf_tune.trajectory.alignment import umeyama

SEEDS = st.integers(0, 2**32 - 1)


def random_trajectory(rng: np.random.Generator, positions: np.ndarray, missing: float = 0.0) -> Trajectory:
    count = len(positions)
    kept = np.flatnonzero(rng.random(count) >= missing)
    return Trajectory(kept, kept / 30, positions[kept], rng.normal(size=(len(kept), 4)))


def family(seed: int, missing: float = 0.0, noise: float = 0.1) -> list[Trajectory]:
    rng = np.random.default_rng(seed)
    positions = rng.normal(size=(40, 3)).cumsum(axis=0)
    return [random_trajectory(rng, positions + noise * rng.normal(size=(40, 3)), missing) for _ in range(5)]


def plain_ate(a: Trajectory, b: Trajectory, alignment: str) -> float:
    ia, ib = associate_by_frame_id(a, b)
    moved = umeyama(b.positions[ib], a.positions[ia], alignment).apply(b.positions[ib])
    return float(np.sqrt(((moved - a.positions[ia]) ** 2).sum(axis=1).mean()))


@pytest.mark.parametrize("alignment", ["sim3", "se3", "none"])
@settings(max_examples=10)
@given(seed=SEEDS)
def test_every_pair_is_measured_over_its_own_frames(alignment, seed):
    runs = family(seed, missing=0.3)

    found = pairwise_matrix(runs[:2], runs[2:], AteSettings(alignment))

    for i in range(2):
        for j in range(3):
            assert found.errors[i, j] == pytest.approx(plain_ate(runs[i], runs[2 + j], alignment), rel=1e-12)
            assert found.matched[i, j] == len(associate_by_frame_id(runs[i], runs[2 + j])[0])
            assert found.errors[i, j] == pytest.approx(ate(runs[i], runs[2 + j], alignment), rel=1e-12)


def test_many_blocks_give_the_same_as_one_by_one(monkeypatch):
    runs = family(3, missing=0.2)
    whole = pairwise_matrix(runs, runs).errors

    monkeypatch.setattr("gtf_tune.metrics.pairwise._BLOCK_COLUMNS", 100)

    np.testing.assert_allclose(pairwise_matrix(runs, runs).errors, whole, rtol=1e-12, atol=1e-15)


@pytest.mark.parametrize("alignment", ["sim3", "se3", "none"])
def test_more_runs_do_not_change_a_bit_of_the_others(alignment):
    runs = family(4)
    more = [*runs[2:], Trajectory.empty(), runs[0].select(np.arange(10)), *family(5)]

    few, many = (pairwise_matrix(runs[:2], some, AteSettings(alignment)).errors for some in (runs[2:], more))

    np.testing.assert_array_equal(many[:, :3], few)


@given(SEEDS, st.floats(-8, 8))
def test_ate_ignores_similarity_transforms(seed, exponent):
    rng = np.random.default_rng(seed)
    a, b = family(seed)[:2]
    turn = Rotation.random(random_state=rng).as_matrix()

    moved = b.transformed(10.0**exponent, turn, 10.0**exponent * rng.normal(size=3))

    assert ate(a, moved) == pytest.approx(ate(a, b), rel=1e-9)


@given(SEEDS, st.floats(-8, 8))
def test_errors_are_in_the_unit_of_the_first_trajectory(seed, exponent):
    a, b = family(seed)[:2]

    scaled = a.transformed(10.0**exponent, np.eye(3), np.zeros(3))

    assert ate(scaled, b) == pytest.approx(10.0**exponent * ate(a, b), rel=1e-9)


@given(SEEDS)
def test_an_aligned_error_never_exceeds_the_extent(seed):
    rng = np.random.default_rng(seed)
    unrelated = [random_trajectory(rng, rng.normal(size=(6, 3)), missing=0.1) for _ in range(4)]

    found = pairwise_matrix(unrelated, unrelated)

    known = ~np.isnan(found.errors)
    assert (found.errors[known] <= found.extents[known] * (1 + 1e-12)).all()


@pytest.mark.parametrize("noise", [1e-6, 1e-9])
def test_tiny_errors_keep_their_digits(noise):
    """Integer positions moved by multiples of a power of two are exact, so the expected error is too."""
    rng = np.random.default_rng(0)
    exact = 2.0 ** round(np.log2(noise))
    positions = rng.integers(-1000, 1000, size=(2000, 3)) / 1024
    steps = rng.integers(-4, 5, size=(2000, 3))
    a, b = (random_trajectory(rng, one) for one in (positions, positions + exact * steps))

    expected = exact * np.sqrt((steps**2).sum(axis=1).mean())

    assert ate(a, b, "none") == pytest.approx(expected, rel=1e-12)
    # The alignment can only take out its seven degrees of freedom of 6,000.
    assert ate(a, b) == pytest.approx(expected, rel=2e-3)
    first_order = _residual_of_linear_fit(positions, exact * steps)
    assert ate(a, b) == pytest.approx(first_order, rel=5e-6 if noise == 1e-6 else 1e-6)


def _residual_of_linear_fit(positions: np.ndarray, offsets: np.ndarray) -> float:
    """Return the RMSE left by the best infinitesimal similarity, exact up to the relative size of the offsets."""
    centred = positions - positions.mean(axis=0)
    columns = [np.cross(axis, centred).ravel() for axis in np.eye(3)]
    columns += [np.tile(axis, len(positions)) for axis in np.eye(3)] + [centred.ravel()]
    design = np.column_stack(columns)
    solution = np.linalg.lstsq(design, offsets.ravel(), rcond=None)[0]
    return float(np.sqrt(((offsets.ravel() - design @ solution) ** 2).sum() / len(positions)))


def test_failed_pairs_carry_a_reason_and_no_number():
    rng = np.random.default_rng(0)
    good = random_trajectory(rng, rng.normal(size=(20, 3)))
    line = random_trajectory(rng, np.arange(20.0)[:, np.newaxis] * [1.0, 2.0, 3.0])
    short = good.select(np.arange(3))
    elsewhere = good.with_frame_ids(good.frame_ids + 1000)

    found = pairwise_matrix([good, line], [good, line, short, elsewhere, Trajectory.empty()])

    assert found.reasons.keys() == {(i, j) for i in range(2) for j in range(5)} - {(0, 0)}
    assert np.isnan(found.errors).sum() == 9
    np.testing.assert_array_equal(np.isnan(found.errors), np.isnan(found.extents))
    assert "second trajectory lie on a line" in found.reasons[0, 1]
    assert "not 3" in found.reasons[0, 2]
    assert "not 0" in found.reasons[0, 3]
    assert "not 0" in found.reasons[0, 4]
    assert "first and the second" in found.reasons[1, 1]


def test_one_bad_pair_leaves_the_others_as_they_were():
    runs = family(1)
    line = runs[0].transformed(0.0, np.eye(3), np.ones(3))

    np.testing.assert_array_equal(
        pairwise_matrix(runs[:2], [*runs[2:], line]).errors[:, :3], pairwise_matrix(runs[:2], runs[2:]).errors
    )


@pytest.mark.parametrize(("a", "b"), [([], []), ([], family(0)), (family(0), [])])
def test_no_trajectories_give_an_empty_matrix(a, b):
    found = pairwise_matrix(a, b)

    assert found.errors.shape == (len(a), len(b))
    assert found.reasons == {}


@pytest.mark.parametrize("alignment", ["se3", "none"])
def test_a_trajectory_of_absurd_size_has_no_error_unless_its_scale_is_fitted(alignment):
    rng = np.random.default_rng(0)
    good = random_trajectory(rng, rng.normal(size=(20, 3)))
    diverged = random_trajectory(rng, 1e300 * rng.normal(size=(20, 3)))

    found = pairwise_matrix([good], [diverged, good], AteSettings(alignment))

    assert 0 < ate(good, diverged) < 2
    assert "comparable size" in found.reasons[0, 0]
    assert found.errors[0, 1] == pytest.approx(0, abs=1e-12)


@pytest.mark.parametrize("relation", ["translation", "rotation"])
def test_relative_errors_of_all_pairs_are_those_of_single_pairs(relation):
    runs = family(2, missing=0.2)
    chosen = RpeSettings(relation, delta=2)

    found = pairwise_matrix(runs[:2], runs[2:], chosen)

    for (i, j), error in np.ndenumerate(found.errors):
        assert error == pytest.approx(rpe(runs[i], runs[2 + j], chosen), rel=1e-12)


def test_pairs_without_poses_far_enough_apart_say_so():
    runs = family(2)

    found = pairwise_matrix(runs[:1], runs[1:2], RpeSettings(delta=1000))

    assert np.isnan(found.errors).all()
    assert found.reasons[0, 0].startswith("expected poses 1000 frames apart, but there are none")


def test_an_associated_matrix_needs_no_frame_ids():
    """Frame ids that only count the poses of each trajectory would pair the wrong ones where a pose is missing."""
    runs = family(5, missing=0.3)
    renumbered = [replace(run, frame_ids=np.arange(len(run))) for run in runs]

    found = associated_matrix(renumbered[:2], renumbered[2:], "timestamp")

    expected = pairwise_matrix(runs[:2], runs[2:])
    np.testing.assert_allclose(found.errors, expected.errors, rtol=1e-12)
    np.testing.assert_allclose(found.extents, expected.extents, rtol=1e-12)
    np.testing.assert_array_equal(found.matched, expected.matched)
    assert associated_matrix(runs[:1], [runs[1].select(np.arange(3))], "timestamp").reasons.keys() == {(0, 0)}
