"""Read a study's outcome: nominal, best, and what choosing the best is worth."""

import math
from collections.abc import Sequence
from dataclasses import dataclass

from gtf_tune.store import trials
from gtf_tune.store.database import Database
from gtf_tune.store.trials import Trial
from gtf_tune.study.student import upper_95


@dataclass(frozen=True)
class Improvement:
    """Hold how much smaller the best score is than nominal's: a fraction, positive where the best trial is better.

    ``low`` and ``high`` bound it with 95 % confidence, paired by noise instance; NaN with fewer than two instances. The
    interval knows nothing of the search having picked the best of many, so it is optimistic until confirmed.
    """

    value: float
    low: float
    high: float
    instances: int


@dataclass(frozen=True)
class Pick:
    """Hold the nominal and the best trial of a study, absent as long as there is none."""

    nominal: Trial | None
    best: Trial | None
    improvement: Improvement | None

    @property
    def is_nominal(self) -> bool:
        """Tell whether nothing beats the nominal setting."""
        return self.best is not None and self.best.ordinal == 0


def pick(database: Database, study_id: int) -> Pick:
    """Return the pick of a study as it stands: the feasible trial of the smallest value."""
    nominal = trials.nominal(database, study_id)
    best = trials.best(database, study_id)
    if nominal is not None and nominal.value is None:
        nominal = None
    if nominal is None or best is None or not nominal.feasible:
        return Pick(nominal, best, None)
    details = trials.details(database, [nominal.id, best.id])
    return Pick(nominal, best, improvement(details[nominal.id]["instances"], details[best.id]["instances"]))


def improvement(nominal: Sequence[float], best: Sequence[float]) -> Improvement:
    """Return the improvement from instance values that are paired by their position.

    The mean log ratio over the instances that both have, with Student's interval: instances share their noise, so the
    ratio of one instance varies far less than its two scores.
    """
    count = min(len(nominal), len(best))
    if count == 0:
        return Improvement(math.nan, math.nan, math.nan, 0)
    import numpy as np  # here: most readers of studies do not need it

    logs = np.log(np.asarray(best[:count], dtype=np.float64) / np.asarray(nominal[:count], dtype=np.float64))
    centre = float(logs.mean())
    if count == 1:
        return Improvement(1 - math.exp(centre), math.nan, math.nan, 1)
    half = float(upper_95(count - 1) * logs.std(ddof=1) / math.sqrt(count))
    return Improvement(1 - math.exp(centre), 1 - math.exp(centre + half), 1 - math.exp(centre - half), count)


def rank_correlation(pairs: Sequence[tuple[float, float]]) -> float:
    """Return Spearman's rank correlation of pairs; NaN for fewer than three."""
    if len(pairs) < 3:
        return math.nan
    from scipy import stats  # takes a second to import

    first, second = zip(*pairs, strict=True)
    return float(stats.spearmanr(first, second).statistic)
