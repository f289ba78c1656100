import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from gtf_tune.errors import DefinitionError
from gtf_tune.gtf import aggregate_instances, aggregate_matrix

AGGREGATES = ["mean", "median", "gmean", "trimmed"]
DTU = np.array([[383, 1.6, 7.3, 2.3, 1.8, 2.5]]) / 1000
MATRICES = st.integers(0, 2**32 - 1).map(
    lambda seed: np.exp(np.random.default_rng(seed).normal(size=(2, 2 + seed % 9)))
)


def test_one_collapsed_run_owns_the_mean_and_nothing_else():
    assert aggregate_matrix(DTU, "mean") > 0.06
    for aggregate in ("median", "trimmed"):
        assert 0.0015 < aggregate_matrix(DTU, aggregate) < 0.004
    assert aggregate_matrix(DTU, "gmean") < 0.007


def test_aggregates_of_known_numbers():
    matrix = np.array([[1.0, 2.0, 4.0, 8.0]])

    assert aggregate_matrix(matrix, "mean") == 3.75
    assert aggregate_matrix(matrix, "median") == 3.0
    assert aggregate_matrix(matrix, "gmean") == pytest.approx(2**1.5)
    assert aggregate_matrix(matrix, "trimmed") == 3.0


def test_trimming_drops_one_bad_column_of_three():
    matrix = np.array([[1.0, 1.1, 100.0], [1.2, 1.3, 120.0]])

    assert aggregate_matrix(matrix, "trimmed") == pytest.approx(1.25)


@pytest.mark.parametrize("aggregate", AGGREGATES)
@given(matrix=MATRICES, factor=st.floats(1e-6, 1e6))
def test_aggregates_follow_the_unit(aggregate, matrix, factor):
    assert aggregate_matrix(factor * matrix, aggregate) == pytest.approx(
        factor * aggregate_matrix(matrix, aggregate), rel=1e-9
    )


@pytest.mark.parametrize("aggregate", AGGREGATES)
@given(matrix=MATRICES)
def test_aggregates_lie_between_the_extremes(aggregate, matrix):
    assert matrix.min() * (1 - 1e-12) <= aggregate_matrix(matrix, aggregate) <= matrix.max() * (1 + 1e-12)


@pytest.mark.parametrize("aggregate", AGGREGATES)
def test_failed_pairs_are_left_out(aggregate):
    with_gap = np.array([[1.0, np.nan, 4.0], [2.0, 8.0, np.nan]])

    assert aggregate_matrix(with_gap, aggregate) == aggregate_matrix(np.array([[1.0, 4.0, 2.0, 8.0]]), aggregate)


@pytest.mark.parametrize("aggregate", AGGREGATES)
@pytest.mark.parametrize("matrix", [np.empty((0, 0)), np.empty((2, 0)), np.full((2, 3), np.nan)])
def test_nothing_has_no_aggregate(aggregate, matrix):
    assert math.isnan(aggregate_matrix(matrix, aggregate))


@pytest.mark.parametrize("aggregate", AGGREGATES)
def test_a_single_value_is_its_own_aggregate(aggregate):
    assert aggregate_matrix(np.array([[0.3]]), aggregate) == pytest.approx(0.3)


def test_a_zero_makes_the_geometric_mean_zero():
    assert aggregate_matrix(np.array([[0.0, 3.0]]), "gmean") == 0


def test_instances_are_the_columns():
    matrix = np.array([[1.0, 2.0, np.nan], [3.0, np.nan, np.nan]])

    np.testing.assert_array_equal(aggregate_instances(matrix, "mean"), [2.0, 2.0, np.nan])


def test_an_unknown_aggregate_is_refused_with_the_known_ones():
    with pytest.raises(DefinitionError, match="mean, median, gmean, trimmed, not 'max'"):
        aggregate_matrix(DTU, "max")
