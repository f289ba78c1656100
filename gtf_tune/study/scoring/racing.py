"""Compare a trial with the incumbent on the noise that both have seen."""

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.special import stdtr

from gtf_tune.gtf.random_effects import COLLAPSE_FACTOR

USUAL_SPREAD = 0.15
"""Standard deviation of paired log ratios before any are seen.

Measured on dtu-scan24 with GLOMAP (16 instances, sigma 2): 0.06 to 0.18 between settings that differ, while the log
scores of one setting spread by 0.5. The analytic pipeline has 0.14.
"""

USUAL_FREEDOM = 3.0
"""Weight of `USUAL_SPREAD`, as degrees of freedom: three ratios that agree by luck are not taken for certainty."""

_FEWEST = 2


@dataclass(frozen=True)
class Comparison:
    """Hold how a trial compares with the incumbent on their common noise instances.

    ``log_ratio`` is the mean of log(own / incumbent), below 0 where the trial is better. ``p_worse`` is the one-sided
    probability of a mean this high or higher if the two were equal: small where the trial is surely worse. ``p_better``
    is that of a mean this low or lower.
    """

    instances: int
    log_ratio: float
    p_worse: float
    p_better: float

    @property
    def percent(self) -> float:
        """Return by how many percent the trial's score is higher than the incumbent's."""
        return 100.0 * math.expm1(self.log_ratio)


def compare(own: Sequence[float], incumbent: Sequence[float], *, collapses_count: bool = False) -> Comparison:
    """Compare two lists of instance values, paired by position; what one has more than the other is left out.

    A t-test on log ratios, with two changes that make it usable from the second instance on. The variance is shrunk
    towards that of usual trials (the moderated t-test of Smyth, Stat. Appl. Genet. Mol. Biol. 3, 2004), and a ratio
    further than `COLLAPSE_FACTOR` from the median is left out, so that one collapsed run cannot decide. Where
    ``collapses_count``, as for a mean, which one collapsed run does decide, it counts as that factor instead.
    """
    common = min(len(own), len(incumbent))
    ratios = _log_ratios(own[:common], incumbent[:common])
    if len(ratios) < _FEWEST:
        return Comparison(len(ratios), float(ratios.mean()) if len(ratios) else 0.0, 1.0, 1.0)
    limit = math.log(COLLAPSE_FACTOR)
    median = float(np.median(ratios))
    kept = np.clip(ratios, median - limit, median + limit)
    near = np.abs(ratios - median) <= limit
    if not collapses_count and near.sum() > common / 2:  # else nobody can say which ones are odd
        kept = ratios[near]
    freedom = USUAL_FREEDOM + len(kept) - 1
    variance = (USUAL_FREEDOM * USUAL_SPREAD**2 + float(((kept - kept.mean()) ** 2).sum())) / freedom
    t = float(kept.mean()) / math.sqrt(variance / len(kept))
    return Comparison(common, float(kept.mean()), float(stdtr(freedom, -t)), float(stdtr(freedom, t)))


def _log_ratios(own: Sequence[float], incumbent: Sequence[float]) -> np.ndarray[tuple[int], np.dtype[np.float64]]:
    smallest = np.finfo(np.float64).tiny
    first, second = (np.log(np.maximum(np.asarray(values, dtype=np.float64), smallest)) for values in (own, incumbent))
    return np.asarray(first - second, dtype=np.float64)
