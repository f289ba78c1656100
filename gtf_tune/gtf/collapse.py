"""Find noisy runs whose reconstruction fell apart.

`benchmarks/interval_coverage.py` measures the rule: where healthy runs spread by a third it marked none of them and
found 89 % (of 3 runs), 99 % (of 4) and all (of 6 and more) of those a hundred times worse.
"""

import math

import numpy as np

from gtf_tune.gtf.random_effects import far_above_either_median, far_above_median
from gtf_tune.trajectory import BoolArray, FloatArray


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
