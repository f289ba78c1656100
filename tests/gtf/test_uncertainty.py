import math

import numpy as np
import pytest
from scipy import stats

from gtf_tune.gtf import estimate
from gtf_tune.gtf.aggregate import complete_table
from gtf_tune.gtf.random_effects import two_way_spread

AGGREGATES = ["mean", "median", "gmean", "trimmed"]
TRUTH = {"mean": math.exp(0.5 * (0.33**2 + 0.1**2)), "median": 1.0, "gmean": 1.0, "trimmed": 1.02}


def rng(seed: int = 0) -> np.random.Generator:
    return np.random.default_rng(seed)


def table(seed: int, shape: tuple[int, int], rows: float, columns: float, rest: float = 0.1) -> np.ndarray:
    draw = rng(seed)
    clean, noisy = draw.normal(size=(shape[0], 1)), draw.normal(size=(1, shape[1]))
    return rows * clean + columns * noisy + rest * draw.normal(size=shape)


def test_the_variance_of_independent_columns_is_the_usual_one():
    values = rng().normal(size=(1, 8))

    found = two_way_spread(values)

    assert found.variance == pytest.approx(values.var(ddof=1) / 8)
    assert found.freedom == 7


@pytest.mark.parametrize(("rows", "columns"), [(0.0, 1.0), (1.0, 0.3), (0.5, 0.5)])
def test_the_variance_formula_is_unbiased_for_random_rows_and_columns(rows, columns):
    tables = [table(seed, (4, 6), rows, columns) for seed in range(3000)]

    predicted = np.mean([two_way_spread(one).variance for one in tables])
    observed = np.var([one.mean() for one in tables])

    # Cutting negative shares of the rows at 0 makes the formula a little conservative.
    assert observed == pytest.approx(predicted, rel=0.1)


def test_pairs_of_one_noisy_run_are_not_independent():
    """Copies of the clean run add pairs but no information."""
    once = np.exp(table(0, (1, 6), 0, 0.3))

    single, tenfold = (estimate(np.repeat(once, times, axis=0), "mean", rng()) for times in (1, 10))

    assert tenfold.standard_error == pytest.approx(single.standard_error)


@pytest.mark.parametrize("aggregate", AGGREGATES)
@pytest.mark.parametrize("noisy_runs", [4, 12])
def test_intervals_hold_the_truth_about_as_often_as_they_say(aggregate, noisy_runs):
    """`benchmarks/interval_coverage.py` is the full table; this catches a wrong formula."""
    hits = 0
    for seed in range(250):
        found = estimate(np.exp(table(seed, (2, noisy_runs), 0.02, 0.33)), aggregate, rng(seed))
        hits += found.low <= TRUTH[aggregate] <= found.high

    low, high = stats.binom.interval(0.999, 250, 0.95)
    assert low - 4 <= hits <= high


@pytest.mark.parametrize("values", [[1.0, 1.01], [1.0, 1.01, 1.02]])
def test_the_bootstrap_of_few_runs_is_not_too_narrow(values):
    """Of two values the trimmed mean is the mean, whose variance is known; of three the median, which varies more."""
    matrix = np.array([values])

    bootstrapped, known = estimate(matrix, "trimmed", rng()), estimate(matrix, "mean", rng())

    assert bootstrapped.standard_error > 0.95 * known.standard_error


@pytest.mark.parametrize("aggregate", AGGREGATES)
def test_uncertainty_follows_the_unit(aggregate):
    matrix = np.exp(table(1, (2, 6), 0.1, 0.3))

    one, thousand = estimate(matrix, aggregate, rng()), estimate(1000 * matrix, aggregate, rng())

    assert thousand.standard_error == pytest.approx(1000 * one.standard_error)
    assert (thousand.low, thousand.high) == pytest.approx((1000 * one.low, 1000 * one.high))


@pytest.mark.parametrize("aggregate", AGGREGATES)
def test_clean_runs_that_differ_widen_the_interval(aggregate):
    alike = np.exp(table(2, (2, 12), 0, 0.3, rest=0.01))
    differing = alike * [[1.0], [3.0]]

    narrow, wide = estimate(alike, aggregate, rng()), estimate(differing, aggregate, rng())

    assert wide.high / wide.low > 2 * narrow.high / narrow.low


@pytest.mark.parametrize("matrix", [np.empty((2, 0)), np.full((2, 3), np.nan), np.ones((2, 1))])
def test_one_noisy_run_says_nothing_about_the_spread(matrix):
    found = estimate(matrix, "mean", rng())

    assert math.isnan(found.standard_error)
    assert math.isnan(found.low)


@pytest.mark.parametrize("aggregate", AGGREGATES)
def test_zeros_among_errors_have_no_interval(aggregate):
    found = estimate(np.array([[0.0, 1.0, 2.0]]), aggregate, rng())

    assert math.isnan(found.low)


def test_only_complete_noisy_runs_count_for_the_spread():
    gaps = np.array([[1.0, np.nan, 4.0], [2.0, 8.0, 5.0], [np.nan, np.nan, np.nan]])

    np.testing.assert_array_equal(complete_table(gaps), [[1.0, 4.0], [2.0, 5.0]])


def test_more_confidence_is_a_wider_interval():
    matrix = np.exp(table(3, (2, 6), 0.1, 0.3))

    usual, careful = (estimate(matrix, "gmean", rng(), confidence) for confidence in (0.95, 0.99))

    assert careful.low < usual.low < usual.high < careful.high
