"""Summaries of errors in the numbers that evo prints."""

from dataclasses import dataclass

import numpy as np

from gtf_tune.errors import TrajectoryError
from gtf_tune.trajectory import FloatArray


@dataclass(frozen=True)
class ErrorStatistics:
    """The usual statistics of errors, in the unit of the errors; ``std`` divides by their number."""

    rmse: float
    mean: float
    median: float
    std: float
    min: float
    max: float
    count: int


def rms(errors: FloatArray) -> float:
    """Return the root of the mean square of errors of shape (m,), m >= 1."""
    return float(np.sqrt(np.mean(errors**2)))


def summarise(errors: FloatArray) -> ErrorStatistics:
    """Return the statistics of errors of shape (m,).

    Raises
    ------
    TrajectoryError
        There are none.
    """
    if not len(errors):
        raise TrajectoryError("expected at least one error to sum up, not none")
    return ErrorStatistics(
        rmse=rms(errors),
        mean=float(errors.mean()),
        median=float(np.median(errors)),
        std=float(errors.std()),
        min=float(errors.min()),
        max=float(errors.max()),
        count=len(errors),
    )
