"""Compare the precision of two configurations, noise instance by noise instance.

Noise instances are common to configurations, so the ratio of errors of one instance varies less than the errors do.
Clean runs are paired too. `benchmarks/interval_coverage.py` measures this test beside the usual ones, at 5 %, k = 2 and
k_delta = 4 to 12: false alarms in 3 to 6 % where clean runs of a configuration agree within 2 %, in up to 9 % where
they differ by 15 %, which a t test or Wilcoxon's over instances takes for a difference of configurations (12 to 26 %).
With 5 % of noisy runs collapsing it finds a gain of 26 % twice as often as the t test; Wilcoxon's cannot find any
before the sixth instance.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.special import stdtr

from gtf_tune.gtf.aggregate import CONFIDENCE, half_width
from gtf_tune.gtf.random_effects import Spread, compared_table, mean_difference
from gtf_tune.gtf.score import GtfScore
from gtf_tune.trajectory import BoolArray, FloatArray


@dataclass(frozen=True, eq=False)
class PairedDifference:
    """How much smaller or larger the errors of configuration b are than those of configuration a.

    Attributes
    ----------
    ratio, low, high
        Geometric mean of error b / error a over pairs, and its 95 % confidence interval; below 1, b is more precise.
    p_value
        Two-sided, of the hypothesis that the ratio is 1.
    n
        Noise instances that were compared.
    left_out
        (m,) which of the common instances were not: they failed under one of the configurations, or their ratio is far
        from the others', as a reconstruction fell apart. That is fragility, to be reported beside precision.
    collapsed_a, collapsed_b
        How many of the common instances collapsed under each configuration.
    """

    ratio: float
    low: float
    high: float
    p_value: float
    n: int
    left_out: BoolArray
    collapsed_a: int
    collapsed_b: int

    @property
    def log_ratio(self) -> float:
        """Return the natural logarithm of the ratio."""
        return math.log(self.ratio)


def paired_difference(a: GtfScore, b: GtfScore, confidence: float = CONFIDENCE) -> PairedDifference:
    """Compare the errors of two configurations under the same noise.

    The test is Student's on the logarithms of error ratios, (k, k_delta), with the variance of a two-way table
    (`two_way_spread`), after leaving out the noise instances whose ratio lies far from the median (by a factor of 5 and
    3.5 median absolute deviations, so always fewer than half): one collapsed run would hide any difference.
    Configurations are compared by geometric means whatever their aggregate is.

    Where one score has more noise instances than the other, those that both have are compared.

    Raises
    ------
    TrajectoryError
        The numbers of clean runs differ, or fewer than two noise instances can be compared.
    """
    return difference_over_sequences([(a, b)], confidence)


def difference_over_sequences(
    pairs: Sequence[tuple[GtfScore, GtfScore]], confidence: float = CONFIDENCE
) -> PairedDifference:
    """Compare two configurations over sequences by the geometric mean of error ratios.

    ``pairs`` are (score of a, score of b) on each sequence. Outliers are left out of each sequence on its own: in a
    mean over sequences one collapse is too small to be recognised and large enough to hide a difference. Counts are
    sums over sequences.

    Raises
    ------
    TrajectoryError
        As in `paired_difference`, on one of the sequences.
    """
    tables, masks = zip(*(compared_table(a.matrix, b.matrix) for a, b in pairs), strict=True)
    center, spread = mean_difference(tables)
    half = half_width(spread, confidence)
    return PairedDifference(
        ratio=math.exp(center),
        low=math.exp(center - half),
        high=math.exp(center + half),
        p_value=_p_value(center, spread),
        n=sum(table.shape[1] for table in tables),
        left_out=np.concatenate(masks),
        collapsed_a=sum(int(a.collapsed[: len(mask)].sum()) for (a, _), mask in zip(pairs, masks, strict=True)),
        collapsed_b=sum(int(b.collapsed[: len(mask)].sum()) for (_, b), mask in zip(pairs, masks, strict=True)),
    )


def holm(p_values: Sequence[float]) -> FloatArray:
    """Return p values corrected for having tested several candidates (Holm, Scand. J. Statistics 6, 1979)."""
    raw = np.asarray(p_values, dtype=np.float64)
    order = np.argsort(raw, kind="stable")
    scaled = np.maximum.accumulate(raw[order] * np.arange(len(raw), 0, -1))
    adjusted = np.empty_like(raw)
    adjusted[order] = np.minimum(scaled, 1.0)
    return adjusted


def _p_value(center: float, spread: Spread) -> float:
    if spread.variance == 0:
        return 1.0 if center == 0 else 0.0
    return float(2 * stdtr(spread.freedom, -abs(center) / math.sqrt(spread.variance)))
