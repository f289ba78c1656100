import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from gtf_tune.errors import DefinitionError
from gtf_tune.gtf import GtfSettings, gtf_score
from gtf_tune.metrics import RpeSettings, ate, rpe
from gtf_tune.trajectory import Trajectory

FRAMES = 40


def runs(count: int, seed: int, noise: float = 0.01, registered: int = FRAMES) -> list[Trajectory]:
    scene = np.random.default_rng(123).normal(size=(FRAMES, 3)).cumsum(axis=0)
    rng = np.random.default_rng(seed)
    kept = np.arange(registered)
    turns = Rotation.from_rotvec(noise * rng.normal(size=(count, registered, 3)).reshape(-1, 3)).as_quat()
    return [
        Trajectory(kept, kept / 30, scene[kept] + noise * rng.normal(size=(registered, 3)), quaternions)
        for quaternions in turns.reshape(count, registered, 4)
    ]


def test_the_score_is_the_mean_over_all_pairs():
    """The paper's equation "metric"."""
    clean, noisy = runs(2, 1), runs(5, 2)

    score = gtf_score(clean, noisy, GtfSettings(normalise="none"), FRAMES)

    assert score.value == pytest.approx(np.mean([ate(a, b) for a in clean for b in noisy]), rel=1e-12)
    assert score.matrix.shape == (2, 5)
    assert score.pair_errors == {}


def test_relative_scores_are_divided_by_the_extent_of_the_clean_run_over_matched_frames():
    clean, noisy = runs(2, 1), runs(3, 2, registered=25)

    relative = gtf_score(clean, noisy, GtfSettings(), FRAMES)
    absolute = gtf_score(clean, noisy, GtfSettings(normalise="none"), FRAMES)

    extents = [np.sqrt(run.positions[:25].var(axis=0).sum()) for run in clean]
    np.testing.assert_allclose(relative.extents, np.tile(extents, (3, 1)).T, rtol=1e-12)
    np.testing.assert_allclose(relative.matrix * relative.extents, absolute.matrix, rtol=1e-12)
    assert relative.extent == pytest.approx(np.mean(extents), rel=1e-12)


@given(st.integers(0, 2**32 - 1), st.floats(0, 100))
@settings(max_examples=30)
def test_a_relative_aligned_score_lies_between_zero_and_one(seed, noise):
    score = gtf_score(runs(2, seed, noise), runs(3, seed + 1, noise), GtfSettings(), FRAMES)

    assert (score.matrix >= 0).all()
    assert (score.matrix <= 1 + 1e-12).all()
    assert GtfSettings().upper_bound == 1


@given(st.floats(-8, 8), st.integers(0, 2**32 - 1))
def test_relative_scores_do_not_depend_on_the_unit_of_a_run(exponent, seed):
    rng = np.random.default_rng(seed)
    clean, noisy = runs(2, 1), runs(3, 2)
    frames = [Rotation.random(random_state=rng).as_matrix() for _ in range(5)]

    moved = [
        one.transformed(10.0**exponent, turn, rng.normal(size=3)) for one, turn in zip(clean, frames, strict=False)
    ]

    np.testing.assert_allclose(
        gtf_score(moved, noisy, GtfSettings(), FRAMES).matrix,
        gtf_score(clean, noisy, GtfSettings(), FRAMES).matrix,
        rtol=1e-6,
    )


@pytest.mark.parametrize("metric", ["rpe_translation", "rpe_rotation"])
def test_relative_pose_errors_can_be_the_metric(metric):
    clean, noisy = runs(2, 1), runs(3, 2)

    score = gtf_score(clean, noisy, GtfSettings(metric=metric, normalise="none", rpe_delta=3), FRAMES)

    chosen = RpeSettings(metric.removeprefix("rpe_"), delta=3)
    assert score.value == pytest.approx(np.mean([rpe(a, b, chosen) for a in clean for b in noisy]), rel=1e-12)


def test_rotations_are_never_divided_by_a_length():
    clean, noisy = runs(2, 1), runs(3, 2)

    relative = gtf_score(clean, noisy, GtfSettings(metric="rpe_rotation"), FRAMES)
    absolute = gtf_score(clean, noisy, GtfSettings(metric="rpe_rotation", normalise="none"), FRAMES)

    np.testing.assert_array_equal(relative.matrix, absolute.matrix)


@pytest.mark.parametrize(
    ("chosen", "bound"),
    [
        (GtfSettings(alignment="se3"), math.inf),
        (GtfSettings(normalise="none"), math.inf),
        (GtfSettings(metric="rpe_translation"), math.inf),
        (GtfSettings(metric="rpe_rotation"), 180),
    ],
)
def test_other_metrics_have_their_own_bound(chosen, bound):
    assert chosen.upper_bound == bound


@pytest.mark.parametrize("word", ["metric", "alignment", "aggregate", "normalise"])
def test_unknown_words_are_refused_with_the_known_ones(word):
    with pytest.raises(DefinitionError, match=f"expected as {word} one of .*, not 'other'"):
        GtfSettings(**{word: "other"})


def test_coverage_counts_registered_frames():
    clean, noisy = runs(2, 1), [*runs(1, 2, registered=10), Trajectory.empty()]

    score = gtf_score(clean, noisy, GtfSettings(), FRAMES)

    assert score.coverage_clean.tolist() == [1, 1]
    assert score.coverage_noisy.tolist() == [0.25, 0]


def test_failed_pairs_have_a_reason_and_do_not_enter_the_score():
    clean, noisy = runs(2, 1), runs(4, 2)

    score = gtf_score(clean, [*noisy, Trajectory.empty()], GtfSettings(), FRAMES)
    without = gtf_score(clean, noisy, GtfSettings(), FRAMES)

    assert score.pair_errors.keys() == {(0, 4), (1, 4)}
    assert np.isnan(score.matrix[:, 4]).all()
    assert score.value == without.value
    assert score.confidence_interval == without.confidence_interval
    assert not score.collapsed[4]


@pytest.mark.parametrize(("clean", "noisy"), [([], []), (runs(2, 1), []), ([Trajectory.empty()], runs(3, 2))])
def test_a_score_of_nothing_is_no_number(clean, noisy):
    score = gtf_score(clean, noisy, GtfSettings(), FRAMES)

    assert math.isnan(score.value)
    assert math.isnan(score.standard_error)
    assert math.isnan(score.extent)
    assert all(math.isnan(end) for end in score.confidence_interval)


def test_identical_runs_score_zero_without_uncertainty():
    clean = runs(1, 1)

    score = gtf_score(clean * 2, clean * 3, GtfSettings(alignment="none"), FRAMES)

    assert (score.value, score.standard_error, score.confidence_interval) == (0, 0, (0, 0))


@pytest.mark.parametrize("aggregate", ["mean", "median", "gmean", "trimmed"])
def test_the_same_runs_give_the_same_score_to_the_last_bit(aggregate):
    clean, noisy = runs(2, 1), runs(6, 2)
    chosen = GtfSettings(aggregate=aggregate)

    first, second = (gtf_score(clean, noisy, chosen, FRAMES) for _ in range(2))

    assert first.value == second.value
    assert first.confidence_interval == second.confidence_interval
    assert first.confidence_interval[0] < first.value < first.confidence_interval[1]


def test_a_collapsed_run_is_found():
    clean, noisy = runs(2, 1), runs(6, 2)
    rng = np.random.default_rng(0)
    broken = Trajectory(noisy[2].frame_ids, noisy[2].timestamps, rng.normal(size=(FRAMES, 3)), noisy[2].quaternions)

    score = gtf_score(clean, [*noisy[:2], broken, *noisy[3:]], GtfSettings(), FRAMES)

    assert score.collapsed.tolist() == [False, False, True, False, False, False]
    assert score.collapse_rate == pytest.approx(1 / 6)


def test_instance_values_follow_the_aggregate():
    clean, noisy = runs(2, 1), runs(3, 2)

    score = gtf_score(clean, noisy, GtfSettings(aggregate="gmean"), FRAMES)

    np.testing.assert_allclose(score.instance_values, np.sqrt(score.matrix[0] * score.matrix[1]), rtol=1e-12)
