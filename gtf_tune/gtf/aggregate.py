"""Turn the matrix of pair errors into one number."""

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from types import MappingProxyType
from typing import Literal, get_args

import numpy as np
from scipy.special import stdtrit

from gtf_tune.gtf.random_effects import (
    Spread,
    combined,
    far_above_either_median,
    far_above_median,
    smallest_errors,
    two_way_spread,
)
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
    collapsed = far_above_median(smallest_errors(matrix))
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
    return far_above_either_median(smallest_errors(a), smallest_errors(b))


def _medians(others: FloatArray) -> FloatArray:
    medians = [float(np.median(row[~np.isnan(row)])) if (~np.isnan(row)).any() else math.nan for row in others]
    return np.array(medians, dtype=np.float64)


CONFIDENCE = 0.95
RESAMPLES = 1000


@dataclass(frozen=True)
class Estimate:
    """An aggregate with its standard error and the ends of its confidence interval, NaN where not estimable."""

    value: float
    standard_error: float
    low: float
    high: float


def half_width(spread: Spread, confidence: float = CONFIDENCE) -> float:
    """Return half the width of the Student-t interval of an estimate."""
    return float(stdtrit(spread.freedom, (1 + confidence) / 2)) * math.sqrt(spread.variance)


def estimate(
    matrix: FloatArray, aggregate: Aggregate, generator: np.random.Generator, confidence: float = CONFIDENCE
) -> Estimate:
    """Return the aggregate of a (k, k_delta) matrix of non-negative errors with its uncertainty.

    The interval is symmetric on the logarithmic scale, so its ends are positive. Its variance is, for ``mean``, that of
    the two-way table; for ``gmean``, that of the table of logarithms; for ``median`` and ``trimmed``, whose formula is
    unknown, that of a bootstrap over noisy runs plus the clean runs' share of the table of logarithms. Quantiles are
    Student's with Satterthwaite's degrees of freedom. Only noisy runs without failed pairs count. With one clean run
    its own variation is unknown and left out; with one noisy run there is no interval.

    Parameters
    ----------
    generator
        Source of the bootstrap's resamples; not used by ``mean`` and ``gmean``.
    """
    value = aggregate_matrix(matrix, aggregate)
    table = complete_table(matrix)
    if table.shape[1] < 2 or math.isnan(value):
        return Estimate(value, math.nan, math.nan, math.nan)
    if (table == table[0, 0]).all():
        return Estimate(value, 0.0, value, value)
    if not (value > 0 and (table > 0).all()):
        return Estimate(value, math.nan, math.nan, math.nan)
    spread = _log_spread(table, aggregate, generator)
    with np.errstate(over="ignore"):
        factor = float(np.exp(half_width(spread, confidence)))
    return Estimate(value, value * math.sqrt(spread.variance), value / factor, value * factor)


def complete_table(matrix: FloatArray) -> FloatArray:
    """Return the rows that hold any number and, of these, the columns without NaN."""
    rows = matrix[~np.isnan(matrix).all(axis=1)]
    return rows[:, ~np.isnan(rows).any(axis=0)]


def _log_spread(table: FloatArray, aggregate: Aggregate, generator: np.random.Generator) -> Spread:
    """Return the spread of the logarithm of an aggregate."""
    if aggregate == "mean":
        linear = two_way_spread(table)
        return Spread(linear.variance / float(table.mean()) ** 2, linear.freedom)
    if aggregate == "gmean":
        return two_way_spread(np.log(table))
    rows, columns = table.shape
    picks = generator.integers(0, columns, size=(RESAMPLES, columns))
    resampled = np.log(aggregate_last_axis(table.T[picks].reshape(RESAMPLES, table.size), aggregate))
    # Resampling n values with replacement has the variance of n - 1.
    noisy = float(np.var(resampled)) * columns / (columns - 1)
    return combined(noisy, columns - 1, _rows_share(np.log(table)), rows - 1)


def _rows_share(table: FloatArray) -> float:
    by_rows_and_columns, by_columns = two_way_spread(table), two_way_spread(table.mean(axis=0, keepdims=True))
    return max(by_rows_and_columns.variance - by_columns.variance, 0.0)
