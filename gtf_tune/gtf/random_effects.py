"""Statistics of tables of errors over clean and noisy runs, with numpy alone: reading a study need not import scipy.

Rows are clean runs, columns noisy ones, (k, k_delta). All pairs of a clean run share it and all pairs of a noisy run
share that, so the variance of a mean over such a table is that of a two-way table with random rows and columns (Searle,
Casella, McCulloch, "Variance components", 1992, ch. 4).
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from gtf_tune.errors import TrajectoryError

FloatArray = NDArray[np.float64]
BoolArray = NDArray[np.bool_]

COLLAPSE_FACTOR = 5.0
"""Times the median error below which no run counts as collapsed; healthy runs spread by about a third."""

COLLAPSE_DEVIATIONS = 3.5
"""Robust standard deviations of the logarithm above the median from which on a run counts as collapsed."""

_MAD_TO_DEVIATION = 1.4826
_FEWEST_FOR_OUTLIERS = 3
FEWEST_INSTANCES = 2


@dataclass(frozen=True)
class Spread:
    """Variance of an estimate, and the degrees of freedom of that variance."""

    variance: float
    freedom: float


def two_way_spread(table: FloatArray) -> Spread:
    """Return the spread of the mean of a complete (k, k_delta >= 2) table with random rows and columns.

    Var(mean) = (MS_rows + MS_columns - MS_rest) / (k k_delta), where the rows' share, MS_rows - MS_rest, is set to 0
    where it comes out negative. With one row the rows' share is unknown and left out.
    """
    rows, columns = table.shape
    mean, row_means, column_means = table.mean(), table.mean(axis=1), table.mean(axis=0)
    between_columns = rows * float(column_means.var(ddof=1))
    between_rows = 0.0
    if rows > 1:
        rest = table - row_means[:, np.newaxis] - column_means + mean
        mean_square_rest = float((rest**2).sum()) / ((rows - 1) * (columns - 1))
        between_rows = max(columns * float(row_means.var(ddof=1)) - mean_square_rest, 0.0)
    return combined(between_columns / table.size, columns - 1, between_rows / table.size, rows - 1)


def combined(columns: float, columns_freedom: int, rows: float, rows_freedom: int) -> Spread:
    """Add two variances, with the degrees of freedom of the sum (Satterthwaite, Biometrics Bulletin 2, 1946)."""
    if rows == 0:
        return Spread(columns, columns_freedom)
    weight = rows / (rows + columns)
    return Spread(rows + columns, 1 / (weight**2 / rows_freedom + (1 - weight) ** 2 / columns_freedom))


def far_above_median(values: FloatArray) -> BoolArray:
    """Return which of the non-negative values, (n,), lie far above the median; NaN never does."""
    deviations, limit = _deviations(_logarithms(values))
    return deviations > limit


def far_above_either_median(a: FloatArray, b: FloatArray) -> tuple[BoolArray, BoolArray]:
    """Return which values of two series, (n,) and (m,), lie far above the smaller of their medians, NaN never.

    Both have one limit, that of the series with the smaller median: where most values of a series are outliers, so is
    its median.
    """
    first, second = _logarithms(a), _logarithms(b)
    medians = [
        float(np.median(series[~np.isnan(series)])) if (~np.isnan(series)).any() else math.inf
        for series in (first, second)
    ]
    lower = first if medians[0] <= medians[1] else second
    _, limit = _deviations(lower)
    return first - min(medians) > limit, second - min(medians) > limit


def far_from_median(logarithms: FloatArray) -> BoolArray:
    """Return which of the logarithms, (n,), lie far from their median on either side; NaN never does."""
    deviations, limit = _deviations(logarithms)
    return np.abs(deviations) > limit


def smallest_errors(table: FloatArray) -> FloatArray:
    """Return the smallest error of each noise instance over clean runs, (n,), of a table (k, n); NaN if all failed."""
    filled = np.where(np.isnan(table), np.inf, table).min(axis=0, initial=np.inf)
    return np.where(np.isinf(filled), np.nan, filled)


def clean_runs_apart(tables: Sequence[FloatArray]) -> BoolArray:
    """Return which clean runs, (k,), fell into another solution under every configuration alike.

    Noisy runs are farther from such a run than from the best clean one by more than `COLLAPSE_FACTOR`, by medians,
    under each configuration. ``tables`` are (k, k_delta) errors of the configurations under the same seeds.
    """
    medians = np.array([[_median(row) for row in table] for table in tables])
    best = np.fmin.reduce(medians, axis=1, keepdims=True)
    return np.asarray((medians > COLLAPSE_FACTOR * best).all(axis=0))


def _median(values: FloatArray) -> float:
    known = values[~np.isnan(values)]
    return float(np.median(known)) if known.size else math.nan


def compared_table(a: FloatArray, b: FloatArray) -> tuple[FloatArray, BoolArray]:
    """Return log(error b / error a), (k, n >= 2), of configurations under the same noise, and what is left out, (m,).

    Of the m noise instances that both have, those are left out that failed under one of the configurations, whose ratio
    lies far from the others', as a reconstruction fell apart, or that fell apart under both alike, which says nothing
    about the choice. Clean runs that failed as a whole are left out too.

    Raises
    ------
    TrajectoryError
        The numbers of clean runs differ, or fewer than two noise instances can be compared.
    """
    logarithms = _log_ratios(a, b)
    failed = np.asarray(np.isnan(logarithms).any(axis=0))
    far = far_from_median(np.where(failed, np.nan, logarithms.sum(axis=0) / max(len(logarithms), 1)))
    left_out = failed | far | _apart_alike(a[:, : len(far)], b[:, : len(far)])
    table = logarithms[:, ~left_out]
    if not len(table) or table.shape[1] < FEWEST_INSTANCES:
        worked = table.shape[1] if len(table) else 0
        raise TrajectoryError(
            f"expected at least {FEWEST_INSTANCES} noise instances that worked under both configurations, not "
            f"{worked}; add noisy runs"
        )
    return table, left_out


def _apart_alike(a: FloatArray, b: FloatArray) -> BoolArray:
    """Return which noise instances, (m,), fell apart under both configurations, by the smallest error over clean runs.

    At most half of the instances are: where more seem to, nothing is known of what is usual.
    """
    return far_above_median(smallest_errors(a)) & far_above_median(smallest_errors(b))


def mean_difference(tables: Sequence[FloatArray]) -> tuple[float, Spread]:
    """Return the mean over sequences of the means of tables, (k, n >= 2) each, with its spread.

    Noise on different sequences is independent, so variances add up. Of logarithms of error ratios this is the
    logarithm of the geometric mean over sequences, whatever their units are.
    """
    spreads = [two_way_spread(table) for table in tables]
    center = float(np.mean([table.mean() for table in tables]))
    if len(spreads) == 1:
        return center, spreads[0]
    shares = [spread.variance / len(tables) ** 2 for spread in spreads]
    squares = sum(share**2 / spread.freedom for share, spread in zip(shares, spreads, strict=True))
    freedom = sum(shares) ** 2 / squares if squares > 0 else min(spread.freedom for spread in spreads)
    return center, Spread(sum(shares), freedom)


def _log_ratios(a: FloatArray, b: FloatArray) -> FloatArray:
    """Return log(error b / error a) of the pairs that both have; NaN where either failed or has no error at all."""
    if len(a) != len(b):
        raise TrajectoryError(f"expected as many clean runs of both configurations, not {len(a)} and {len(b)}")
    common = min(a.shape[1], b.shape[1])
    first, second = (np.where(table[:, :common] > 0, table[:, :common], np.nan) for table in (a, b))
    logarithms: FloatArray = np.log(second) - np.log(first)
    return logarithms[~np.isnan(logarithms).all(axis=1)]


def _logarithms(values: FloatArray) -> FloatArray:
    return np.log(np.maximum(values, np.finfo(np.float64).tiny))


def _deviations(logarithms: FloatArray) -> tuple[FloatArray, float]:
    """Return the deviations from the median, 0 for NaN, and the size from which on they are far."""
    known = ~np.isnan(logarithms)
    if known.sum() < _FEWEST_FOR_OUTLIERS:
        return np.zeros(len(logarithms)), math.inf
    deviations = np.where(known, logarithms - np.median(logarithms[known]), 0.0)
    spread = _MAD_TO_DEVIATION * float(np.median(np.abs(deviations[known])))
    return deviations, max(math.log(COLLAPSE_FACTOR), COLLAPSE_DEVIATIONS * spread)
