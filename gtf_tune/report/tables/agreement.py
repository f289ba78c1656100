"""Compare the score with ground truth and with the reprojection error."""

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from scipy import stats

from gtf_tune.report.tables.points import TrialPoint
from gtf_tune.trajectory import FloatArray

_FEWEST = 3
_LOG_FROM_RATIO = 30.0


@dataclass(frozen=True, eq=False)
class Agreement:
    """Hold a scatter of n trials with its least-squares line.

    ``r_squared`` is the squared correlation of the values as they are (the paper's figure of merit), ``spearman`` the
    rank correlation; both NaN, as ``slope`` and ``intercept``, where either side is constant. ``is_log`` says that the
    values spread so far that axes should be logarithmic.
    """

    x: FloatArray
    y: FloatArray
    ordinals: tuple[int, ...]
    slope: float
    intercept: float
    r_squared: float
    spearman: float
    is_log: tuple[bool, bool]

    def line(self, count: int = 50) -> tuple[FloatArray, FloatArray]:
        """Return points on the regression line over the range of x, evenly spread on the scale of its axis."""
        low, high = float(self.x.min()), float(self.x.max())
        along = np.geomspace(low, high, count) if self.is_log[0] else np.linspace(low, high, count)
        return along, self.intercept + self.slope * along


def agreement(
    points: Sequence[TrialPoint], x: Callable[[TrialPoint], float], y: Callable[[TrialPoint], float]
) -> Agreement | None:
    """Return how two numbers of the feasible trials go together, or None for fewer than three trials with both."""
    chosen = [one for one in points if one.is_scored and math.isfinite(x(one)) and math.isfinite(y(one))]
    if len(chosen) < _FEWEST:
        return None
    xs, ys = np.array([x(one) for one in chosen]), np.array([y(one) for one in chosen])
    slope = intercept = r_squared = spearman = math.nan
    if np.ptp(xs) > 0 and np.ptp(ys) > 0:
        fit = stats.linregress(xs, ys)
        slope, intercept, r_squared = float(fit.slope), float(fit.intercept), float(fit.rvalue) ** 2
        spearman = float(stats.spearmanr(xs, ys).statistic)
    ordinals = tuple(one.ordinal for one in chosen)
    return Agreement(xs, ys, ordinals, slope, intercept, r_squared, spearman, (_spreads_far(xs), _spreads_far(ys)))


def _spreads_far(values: FloatArray) -> bool:
    return bool(values.min() > 0 and values.max() / values.min() > _LOG_FROM_RATIO)
