"""Compare a trial with nominal noise instance by noise instance, as a confirmation does."""

import math
from collections.abc import Mapping
from typing import Any

import numpy as np

from gtf_tune.errors import TrajectoryError
from gtf_tune.gtf.random_effects import compared_table, mean_difference
from gtf_tune.gtf.uncertainty import half_width
from gtf_tune.study.outcome.improvement import UNKNOWN_IMPROVEMENT, Improvement
from gtf_tune.study.scoring.objective import TrialScore
from gtf_tune.trajectory import FloatArray

_LARGEST_LOG = 700.0

Matrices = Mapping[str, FloatArray]


def paired_improvement(nominal: Matrices, other: Matrices) -> Improvement:
    """Return how much smaller the errors of a trial are than nominal's.

    Pairs of runs share their clean and their noisy images, so errors are compared pair by pair (`compared_table`): the
    interval counts clean and noisy runs, and an instance that fell apart under one of the two is left out. Over several
    sequences ratios are combined by their geometric mean.

    Parameters
    ----------
    nominal, other
        (k, k_delta) errors by sequence, NaN where a pair failed. One may have more noise instances than the other.

    Returns
    -------
    Improvement
        `UNKNOWN_IMPROVEMENT` where either has no errors on one of the sequences, or nothing can be compared.
    """
    if not nominal or nominal.keys() != other.keys():
        return UNKNOWN_IMPROVEMENT
    pairs = [(nominal[name], other[name]) for name in nominal]
    if not all(one.size for pair in pairs for one in pair):
        return UNKNOWN_IMPROVEMENT
    try:
        tables = [compared_table(*pair)[0] for pair in pairs]
    except TrajectoryError:
        return _without_interval(pairs)
    center, spread = mean_difference(tables)
    half = half_width(spread)
    low, high = (1 - math.exp(min(center + side * half, _LARGEST_LOG)) for side in (1, -1))
    return Improvement(1 - math.exp(center), low, high, sum(table.shape[1] for table in tables))


def stored_matrices(detail: Mapping[str, Any]) -> dict[str, FloatArray]:
    """Return the (k, k_delta) errors by sequence from what is stored with a trial; empty where it has none."""
    stored = {name: one.get("matrix") for name, one in detail.get("sequences", {}).items()}
    if not all(stored.values()):
        return {}
    return {name: np.array(matrix, dtype=np.float64) for name, matrix in stored.items()}  # None becomes NaN


def score_matrices(score: TrialScore) -> dict[str, FloatArray]:
    """Return the (k, k_delta) errors by sequence of a trial that may be used; empty where it is infeasible."""
    if not score.feasible:
        return {}
    return {name: one.score.matrix for name, one in score.by_sequence.items() if one.score is not None}


def _without_interval(pairs: list[tuple[FloatArray, FloatArray]]) -> Improvement:
    """Return the improvement over the first noisy runs where there are too few of them for more."""
    if any(len(first) != len(second) for first, second in pairs):
        return UNKNOWN_IMPROVEMENT
    with np.errstate(divide="ignore", invalid="ignore"):
        means = [float((np.log(second[:, :1]) - np.log(first[:, :1])).mean()) for first, second in pairs]
    if not all(map(math.isfinite, means)):
        return UNKNOWN_IMPROVEMENT
    return Improvement(1 - math.exp(sum(means) / len(means)), math.nan, math.nan, 1)
