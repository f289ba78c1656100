"""Turn the matrix of pair errors into one number."""

import math
from collections.abc import Callable, Mapping
from types import MappingProxyType
from typing import Literal, get_args

import numpy as np

from gtf_tune.metrics import check_word
from gtf_tune.trajectory import FloatArray

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
