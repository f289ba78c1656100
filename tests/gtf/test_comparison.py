import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy import stats

from gtf_tune.errors import TrajectoryError
from gtf_tune.gtf import GtfScore, find_collapsed, holm, paired_difference


def score_of(matrix: np.ndarray) -> GtfScore:
    unused = np.ones(matrix.shape)
    return GtfScore(
        value=float(np.nanmean(matrix)),
        standard_error=math.nan,
        confidence_interval=(math.nan, math.nan),
        matrix=matrix,
        pair_errors={},
        coverage_clean=unused[:, 0],
        coverage_noisy=unused[0],
        extents=unused,
        matched=unused.astype(np.int64),
        num_frames=1,
        collapsed=find_collapsed(matrix),
    )


def settings_pair(seed: int, effect: float = 0.0, noisy: int = 8, clean_spread: float = 0.02) -> list[np.ndarray]:
    rng = np.random.default_rng(seed)
    instances = 0.25 * rng.normal(size=(1, noisy))
    return [
        np.exp(
            shift
            + instances
            + clean_spread * rng.normal(size=(2, 1))
            + 0.1 * rng.normal(size=(1, noisy))
            + 0.05 * rng.normal(size=(2, noisy))
        )
        for shift in (0.0, effect)
    ]


def compare(a: np.ndarray, b: np.ndarray):
    return paired_difference(score_of(a), score_of(b))


def test_one_clean_run_gives_the_paired_t_test_on_logarithms():
    a, b = (matrix[:1] for matrix in settings_pair(1, effect=-0.1))

    found = compare(a, b)

    peer = stats.ttest_rel(np.log(b[0]), np.log(a[0]))
    assert found.p_value == pytest.approx(peer.pvalue)
    assert (found.low, found.high) == pytest.approx(tuple(np.exp(peer.confidence_interval())))
    assert found.log_ratio == pytest.approx(np.log(b / a).mean())
    assert found.n == 8


def test_a_difference_smaller_than_the_spread_is_seen_through_the_pairing():
    a, b = settings_pair(2, effect=-0.3)

    found = compare(a, b)

    assert found.p_value < 0.01
    assert found.low < math.exp(-0.3) < found.high < 1
    assert np.log(a).std() > 0.2


@given(st.integers(0, 2**32 - 1))
def test_swapping_the_settings_inverts_the_ratio(seed):
    a, b = settings_pair(seed, effect=0.1)

    forth, back = compare(a, b), compare(b, a)

    assert forth.ratio == pytest.approx(1 / back.ratio)
    assert (forth.low, forth.high) == pytest.approx((1 / back.high, 1 / back.low))
    assert forth.p_value == pytest.approx(back.p_value)


def test_one_collapsed_run_does_not_hide_the_difference():
    a, b = settings_pair(3, effect=-0.3)
    b[:, 2] *= 150

    found = compare(a, b)

    assert found.left_out.tolist() == [False, False, True, False, False, False, False, False]
    assert (found.collapsed_a, found.collapsed_b, found.n) == (0, 1, 7)
    assert found.p_value < 0.01


def test_half_of_the_instances_are_never_left_out():
    a, b = settings_pair(3, noisy=4)
    a[:, :2] *= 100

    found = compare(a, b)

    assert not found.left_out.any()
    assert found.p_value > 0.1


@pytest.mark.parametrize("clean_spread", [0.02, 0.1])
def test_equal_settings_are_rarely_called_different(clean_spread):
    alarms = sum(compare(*settings_pair(seed, clean_spread=clean_spread)).p_value < 0.05 for seed in range(400))

    # 5 % wanted; with two clean runs their spread is known from one degree of freedom, hence up to 9 % (benchmark).
    assert alarms <= stats.binom.ppf(0.999, 400, 0.09)


def test_differences_between_clean_runs_are_not_differences_of_settings():
    a, b = settings_pair(5, noisy=12)
    a[0] *= 1.6

    found = compare(a, b)

    assert stats.ttest_rel(np.log(a).mean(axis=0), np.log(b).mean(axis=0)).pvalue < 0.01
    assert found.p_value > 0.2


def test_failed_pairs_and_clean_runs_are_left_out():
    a, b = settings_pair(6)
    a[0, 3] = np.nan
    one_row_less = [np.vstack([one, np.full(8, np.nan)]) for one in (a, b)]

    assert compare(a, b).n == 7
    assert compare(*one_row_less).p_value == compare(a, b).p_value


def test_common_instances_are_the_first_ones():
    a, b = settings_pair(7, noisy=10)

    assert compare(a, b[:, :6]).p_value == compare(a[:, :6], b[:, :6]).p_value


def test_the_same_setting_is_not_different_from_itself():
    a, _ = settings_pair(8)

    found = compare(a, a)

    assert (found.ratio, found.low, found.high, found.p_value) == (1, 1, 1, 1)


@pytest.mark.parametrize(
    ("a", "b"),
    [
        (np.ones((2, 1)), np.ones((2, 1))),
        (np.ones((2, 5)), np.full((2, 5), np.nan)),
        (np.zeros((2, 5)), np.ones((2, 5))),
        (np.ones((2, 0)), np.ones((2, 4))),
    ],
)
def test_nothing_to_compare_is_refused(a, b):
    with pytest.raises(TrajectoryError, match="at least 2 noise instances that worked under both configurations, not"):
        paired_difference(_quiet(a), _quiet(b))


def _quiet(matrix: np.ndarray) -> GtfScore:
    filled = score_of(np.ones((matrix.shape[0], max(matrix.shape[1], 1))))
    collapsed = np.zeros(matrix.shape[1], dtype=bool)
    return GtfScore(**{**vars(filled), "matrix": matrix, "collapsed": collapsed})


def test_numbers_of_clean_runs_must_agree():
    with pytest.raises(TrajectoryError, match="as many clean runs of both configurations, not 2 and 3"):
        compare(np.ones((2, 4)), np.ones((3, 4)))


def test_holm_is_the_textbook_example():
    np.testing.assert_allclose(holm([0.01, 0.04, 0.03, 0.005]), [0.03, 0.06, 0.06, 0.02])


@given(st.lists(st.floats(0, 1), max_size=8))
def test_holm_lies_between_no_correction_and_bonferroni_and_keeps_the_order(p_values):
    found = holm(p_values)

    assert (found >= p_values).all()
    assert (found <= np.minimum(np.array(p_values) * len(p_values), 1) + 1e-15).all()
    assert (np.diff(found[np.argsort(p_values, kind="stable")]) >= 0).all()
