import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from gtf_tune.report.panels.agreement import Agreement, agreement, r_squared_by_runs
from gtf_tune.report.points import TrialPoint


def compare(xs: list[float], ys: list[float]) -> Agreement | None:
    points = [TrialPoint(n, "feasible", value=x, ground_truth=y) for n, (x, y) in enumerate(zip(xs, ys, strict=True))]
    return agreement(points, lambda one: one.value, lambda one: one.ground_truth)


@given(slope=st.floats(0.1, 10), intercept=st.floats(-5, 5))
def test_points_on_a_line_agree_completely(slope: float, intercept: float) -> None:
    xs = [1.0, 2.0, 4.0, 5.0]

    found = compare(xs, [intercept + slope * x for x in xs])

    assert found is not None
    assert (found.slope, found.r_squared, found.spearman) == pytest.approx((slope, 1.0, 1.0))
    assert found.intercept == pytest.approx(intercept, abs=1e-9)


def test_a_monotone_curve_has_full_rank_correlation_but_not_a_full_r_squared() -> None:
    found = compare([1, 2, 3, 4, 5], [1, 2, 4, 8, 100])

    assert found is not None
    assert found.spearman == pytest.approx(1)
    assert found.r_squared < 0.7


def test_two_points_tell_nothing() -> None:
    assert compare([1, 2], [1, 2]) is None


def test_trials_without_one_of_the_numbers_are_left_out() -> None:
    found = compare([1, 2, 3, 4], [1, math.nan, 3, 4])

    assert found is not None
    assert found.numbers == (0, 2, 3)


def test_a_constant_side_has_no_correlation() -> None:
    found = compare([1, 1, 1], [1, 2, 3])

    assert found is not None
    assert math.isnan(found.r_squared)
    assert math.isnan(found.spearman)


def test_axes_become_logarithmic_where_one_collapsed_trial_would_hide_the_rest() -> None:
    found = compare([1, 2, 383], [1, 2, 3])

    assert found is not None
    assert found.is_log == (True, False)


def test_the_regression_line_spans_the_points() -> None:
    found = compare([1, 2, 4], [2, 4, 8])

    assert found is not None
    x, y = found.line()
    assert (x[0], x[-1]) == (1, 4)
    assert np.allclose(y, 2 * x)


def test_more_noisy_runs_agree_better_with_the_true_error() -> None:
    generator = np.random.default_rng(0)
    truth = np.linspace(1.0, 2.0, 8)
    matrices = [error * np.exp(0.5 * generator.standard_normal((2, 12))) for error in truth]

    values = r_squared_by_runs(matrices, truth, "mean")

    assert len(values) == 12
    assert values[-1] > values[2] > values[0]
    exact = r_squared_by_runs([np.full((1, 3), error) for error in truth], truth, "median")
    assert np.allclose(exact, 1.0)
