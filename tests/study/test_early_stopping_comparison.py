import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from gtf_tune.gtf.random_effects import COLLAPSE_FACTOR
from gtf_tune.study.scoring.early_stopping import USUAL_FREEDOM, USUAL_SPREAD, compare

scores = st.floats(1e-6, 1.0)
paired = st.lists(st.tuples(scores, scores), min_size=2, max_size=30)


@given(paired, st.floats(1e-3, 1e3))
def test_comparisons_do_not_depend_on_the_unit(pairs: list[tuple[float, float]], factor: float) -> None:
    own, other = zip(*pairs, strict=True)

    found = compare([factor * value for value in own], [factor * value for value in other])

    assert found.log_ratio == pytest.approx(compare(own, other).log_ratio, abs=1e-9)
    assert found.p_worse == pytest.approx(compare(own, other).p_worse, abs=1e-6)


@given(paired)
def test_swapping_the_trials_swaps_better_and_worse(pairs: list[tuple[float, float]]) -> None:
    own, other = zip(*pairs, strict=True)

    forward, backward = compare(own, other), compare(other, own)

    assert forward.log_ratio == pytest.approx(-backward.log_ratio, abs=1e-12)
    assert forward.p_worse == pytest.approx(backward.p_better, abs=1e-12)
    assert forward.p_worse + forward.p_better == pytest.approx(1.0)


def test_the_luck_that_both_share_cancels() -> None:
    luck = np.exp(np.random.default_rng(0).normal(scale=1.0, size=6))

    found = compare((1.3 * luck).tolist(), luck.tolist())

    assert found.log_ratio == pytest.approx(math.log(1.3))
    assert found.percent == pytest.approx(30.0)
    assert found.p_worse < 0.01


def test_only_instances_that_both_have_count() -> None:
    assert compare([1.0, 2.0, 99.0], [1.0, 1.0]) == compare([1.0, 2.0], [1.0, 1.0])


@pytest.mark.parametrize("own", [[], [5.0]])
def test_fewer_than_two_instances_decide_nothing(own: list[float]) -> None:
    found = compare(own, [1.0, 1.0, 1.0])

    assert (found.p_worse, found.p_better) == (1.0, 1.0)


def test_three_ratios_that_agree_by_luck_are_not_taken_for_certainty() -> None:
    found = compare([1.02, 1.02, 1.02], [1.0, 1.0, 1.0])

    assert 0.3 < found.p_worse < 0.5


def test_the_variance_is_the_weighted_mean_of_usual_and_seen() -> None:
    ratios = np.array([0.3, 0.5, 0.1, 0.3])
    variance = (USUAL_FREEDOM * USUAL_SPREAD**2 + 3 * ratios.var(ddof=1)) / (USUAL_FREEDOM + 3)

    found = compare(np.exp(ratios).tolist(), [1.0] * 4)

    from scipy import stats

    assert found.p_worse == pytest.approx(stats.t.sf(0.3 / math.sqrt(variance / 4), USUAL_FREEDOM + 3))


def test_one_collapsed_run_decides_nothing() -> None:
    others = [1.0, 1.1, 0.9, 1.0]

    assert compare([*others, 1e4], [1.0] * 5).p_worse > 0.3
    assert compare([1.0, 1.0, 100.0], [1.0] * 3).log_ratio == pytest.approx(0.0)


def test_where_two_camps_of_ratios_are_far_apart_none_is_left_out() -> None:
    found = compare([1.0, 1.0, 1e4, 1e4], [1.0] * 4)

    assert found.log_ratio > 1.0


def test_for_a_mean_one_collapsed_run_counts_as_a_limited_factor() -> None:
    others = [0.9, 0.9, 0.9, 0.9]

    mild, wild = (compare([*others, last], [1.0] * 5, collapses_count=True) for last in (10.0, 1e4))

    assert mild == wild
    assert wild.log_ratio == pytest.approx((5 * math.log(0.9) + math.log(COLLAPSE_FACTOR)) / 5)
    assert wild.p_worse > 0.1


def test_a_score_of_zero_is_compared_without_warning() -> None:
    assert compare([0.0, 0.0], [1.0, 1.0]).p_better < 0.01


def test_equal_settings_are_rarely_called_worse() -> None:
    generator = np.random.default_rng(1)

    wrong = [compare(*np.exp(generator.normal(scale=0.1, size=(2, 6)))).p_worse < 0.1 for _ in range(2000)]

    assert np.mean(wrong) < 0.12
