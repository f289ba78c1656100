"""Find noisy runs whose reconstruction fell apart.

`benchmarks/interval_coverage.py` measures the rule: where healthy runs spread by a third it marked none of them and
found 89 % (of 3 runs), 99 % (of 4) and all (of 6 and more) of those a hundred times worse.
"""

import math

import numpy as np

from gtf_tune.trajectory import BoolArray, FloatArray

COLLAPSE_FACTOR = 5.0
"""Times the median error below which no run counts as collapsed; healthy runs spread by about a third."""

COLLAPSE_DEVIATIONS = 3.5
"""Robust standard deviations of the logarithm above the median from which on a run counts as collapsed."""

_MAD_TO_DEVIATION = 1.4826
_FEWEST = 3


def find_collapsed(matrix: FloatArray, noisy_noisy: FloatArray | None = None) -> BoolArray:
    """Return which noisy runs collapsed, (k_delta,).

    A noisy run is far out when its error exceeds the median by a factor of 5 and by 3.5 robust deviations of the
    logarithm (median absolute deviation, Iglewicz and Hoaglin, 1993). Its error is the smallest over clean runs: a run
    that agrees with any clean run has not collapsed.

    With fewer than 3 noisy runs nobody can say which is the odd one, and none is marked; when half of them or more
    collapse, the median is theirs and they are not found.

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


def far_above_median(values: FloatArray) -> BoolArray:
    """Return which of the non-negative values, (n,), lie far above the median; NaN never does."""
    deviations, limit = _deviations(np.log(np.maximum(values, np.finfo(np.float64).tiny)))
    return deviations > limit


def far_from_median(logarithms: FloatArray) -> BoolArray:
    """Return which of the logarithms, (n,), lie far from their median on either side; NaN never does."""
    deviations, limit = _deviations(logarithms)
    return np.abs(deviations) > limit


def _deviations(logarithms: FloatArray) -> tuple[FloatArray, float]:
    """Return the deviations from the median, 0 for NaN, and the size from which on they are far."""
    known = ~np.isnan(logarithms)
    if known.sum() < _FEWEST:
        return np.zeros(len(logarithms)), math.inf
    deviations = np.where(known, logarithms - np.median(logarithms[known]), 0.0)
    spread = _MAD_TO_DEVIATION * float(np.median(np.abs(deviations[known])))
    return deviations, max(math.log(COLLAPSE_FACTOR), COLLAPSE_DEVIATIONS * spread)


def _smallest(matrix: FloatArray) -> FloatArray:
    filled = np.where(np.isnan(matrix), np.inf, matrix).min(axis=0, initial=np.inf)
    return np.where(np.isinf(filled), np.nan, filled)


def _medians(others: FloatArray) -> FloatArray:
    medians = [float(np.median(row[~np.isnan(row)])) if (~np.isnan(row)).any() else math.nan for row in others]
    return np.array(medians, dtype=np.float64)
