"""Turn the matrix of pair errors into one number."""

import math
from collections.abc import Callable, Mapping
from types import MappingProxyType
from typing import Literal, get_args

import numpy as np

from gtf_tune.gtf.random_effects import far_above_either_median, far_above_median
from gtf_tune.metrics import check_word
from gtf_tune.trajectory import BoolArray, FloatArray

Aggregate = Literal["mean", "median", "gmean", "trimmed"]

TRIMMED_SHARE = 0.25
"""Share of the values that the trimmed mean drops at each end, rounded up, so that it drops one bad column of four."""


def aggregate_matrix(matrix: FloatArray, aggregate: Aggregate) -> float:
    """Return one number for a (k, k_delta) matrix of errors, leaving out failed pairs (NaN).

    ``mean`` is the paper's eq. "metric"; ``gmean`` the geometric mean; ``trimmed`` the mean of the middle half. NaN
    when no pair is left.

    Raises
    ------
    DefinitionError
        The aggregate is unknown.
    """
    values = matrix[~np.isnan(matrix)]
    return float(aggregate_last_axis(values, aggregate)) if values.size else math.nan


def aggregate_instances(matrix: FloatArray, aggregate: Aggregate) -> FloatArray:
    """Return one number for each noise instance, (k_delta,): the aggregate over clean runs of a (k, k_delta) matrix."""
    return np.array([aggregate_matrix(column, aggregate) for column in matrix.T], dtype=np.float64)


def aggregate_last_axis(values: FloatArray, aggregate: Aggregate) -> FloatArray:
    """Return one number for each row of values of shape (..., n), n >= 1 and free of NaN.

    Raises
    ------
    DefinitionError
        The aggregate is unknown.
    """
    check_word("aggregate", aggregate, get_args(Aggregate))
    return np.asarray(_AGGREGATES[aggregate](values), dtype=np.float64)


def _mean(values: FloatArray) -> FloatArray:
    return np.asarray(values.mean(axis=-1))


def _median(values: FloatArray) -> FloatArray:
    return np.asarray(np.median(values, axis=-1))


def _gmean(values: FloatArray) -> FloatArray:
    with np.errstate(divide="ignore"):
        return np.asarray(np.exp(np.log(values).mean(axis=-1)))


def _trimmed(values: FloatArray) -> FloatArray:
    count = values.shape[-1]
    cut = min(math.ceil(TRIMMED_SHARE * count), (count - 1) // 2)
    return np.asarray(np.sort(values, axis=-1)[..., cut : count - cut].mean(axis=-1))


_AGGREGATES: Mapping[str, Callable[[FloatArray], FloatArray]] = MappingProxyType(
    {"mean": _mean, "median": _median, "gmean": _gmean, "trimmed": _trimmed}
)


def find_collapsed(matrix: FloatArray, noisy_noisy: FloatArray | None = None) -> BoolArray:
    """Return which noisy runs collapsed, (k_delta,).

    A noisy run is far out when its error exceeds the median by a factor of 5 and by 3.5 robust deviations of the
    logarithm (median absolute deviation, Iglewicz and Hoaglin, 1993). Its error is the smallest over clean runs: a run
    that agrees with any clean run has not collapsed.

    With fewer than 3 noisy runs no run can be called the outlier, and none is marked. Where half of them or more
    collapse, the median is that of collapsed runs, and they are not found.

    Parameters
    ----------
    matrix
        (k, k_delta) errors of noisy against clean runs; failed pairs are NaN and are not counted as collapsed.
    noisy_noisy
        (k_delta, k_delta) errors of noisy runs against each other. With it a run is also marked when its median error
        against the other noisy runs is far out, which still works when a clean run collapsed.
    """
    collapsed = far_above_median(_smallest(matrix))
    if noisy_noisy is None:
        return collapsed
    others = np.where(np.eye(len(noisy_noisy), dtype=bool), np.nan, noisy_noisy)
    return collapsed | far_above_median(_medians(others))


def common_collapses(a: FloatArray, b: FloatArray) -> tuple[BoolArray, BoolArray]:
    """Return which noisy runs collapsed under two configurations by one limit, (k_delta,) each.

    The limit is that of the more precise configuration: where most runs of a configuration collapse, its own median
    does not show it, and a run that is as good as the usual ones of the other configuration has not collapsed.

    Parameters
    ----------
    a, b
        (k, k_delta) errors of noisy against clean runs, NaN where a pair failed.
    """
    return far_above_either_median(_smallest(a), _smallest(b))


def _smallest(matrix: FloatArray) -> FloatArray:
    filled = np.where(np.isnan(matrix), np.inf, matrix).min(axis=0, initial=np.inf)
    return np.where(np.isinf(filled), np.nan, filled)


def _medians(others: FloatArray) -> FloatArray:
    medians = [float(np.median(row[~np.isnan(row)])) if (~np.isnan(row)).any() else math.nan for row in others]
    return np.array(medians, dtype=np.float64)
