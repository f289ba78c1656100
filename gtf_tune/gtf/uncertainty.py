"""Standard errors and confidence intervals of scores.

Pairs (clean i, noisy j) are not independent: all pairs of a clean run share it, and so do all pairs of a noisy run. The
variance of a mean over a (k, k_delta) matrix is therefore that of a two-way table (`gtf_tune.gtf.random_effects`).

`benchmarks/interval_coverage.py` measures how often these intervals hold the truth and is the reason for each choice
here. With k = 2 and k_delta = 4 to 12 the 95 % interval does so in 94 to 97 % (98 % for medians of few runs). When 5 %
of noisy runs collapse, ``median`` and ``trimmed`` keep that; ``gmean`` falls to 68 to 91 % and ``mean`` to 15 to 43 %:
an interval cannot cover a collapse that did not occur in its runs.
"""

import math
from dataclasses import dataclass

import numpy as np
from scipy.special import stdtrit

from gtf_tune.gtf.aggregate import Aggregate, aggregate_last_axis, aggregate_matrix
from gtf_tune.gtf.random_effects import Spread, combined, two_way_spread
from gtf_tune.trajectory import FloatArray

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
