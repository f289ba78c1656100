"""Read a study's outcome: nominal, best, and what choosing the best is worth."""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

from gtf_tune.errors import TrajectoryError
from gtf_tune.store import trials
from gtf_tune.store.database import Database
from gtf_tune.store.trials import Trial
from gtf_tune.study.outcome.student import upper_95

if TYPE_CHECKING:
    from gtf_tune.trajectory import FloatArray

_LARGEST_LOG = 700.0


@dataclass(frozen=True)
class Improvement:
    """Hold how much smaller the best score is than nominal's: a fraction, positive where the best trial is better.

    ``low`` and ``high`` bound it with 95 % confidence, paired by noise instance; NaN with fewer than two instances that
    worked under both. The interval knows nothing of the search having picked the best of many, so it is optimistic
    until confirmed.
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
        """Tell whether nothing beats the nominal setting; a trial that repeats its options does not."""
        if self.best is None or self.nominal is None:
            return False
        return self.best.number == 0 or self.best.options == self.nominal.options


UNKNOWN_IMPROVEMENT = Improvement(math.nan, math.nan, math.nan, 0)


def pick(database: Database, study_id: int) -> Pick:
    """Return the pick of a study as it stands: the feasible trial of the smallest value."""
    nominal = trials.nominal(database, study_id)
    best = trials.best(database, study_id)
    if nominal is not None and nominal.value is None:
        nominal = None
    if nominal is None or best is None or not nominal.feasible:
        return Pick(nominal, best, None)
    details = trials.details(database, [nominal.id, best.id])
    return Pick(nominal, best, improvement(details[nominal.id], details[best.id]))


def improvement(nominal: Mapping[str, Any], best: Mapping[str, Any]) -> Improvement:
    """Return the improvement from what is stored of two trials in detail: their matrices by sequence.

    Errors of pairs share their clean and their noisy images, so they are compared pair by pair, as a confirmation does
    (`compared_table`): the interval counts clean and noisy runs, and an instance that fell apart under one of the
    settings is left out. ``instances`` counts those of all sequences.
    """
    from gtf_tune.gtf.random_effects import compared_table, mean_difference  # here: most readers need no numpy

    tables = [_matrices(one) for one in (nominal, best)]
    if not all(tables) or len(tables[0]) != len(tables[1]):
        return UNKNOWN_IMPROVEMENT
    try:
        compared = [compared_table(first, second)[0] for first, second in zip(*tables, strict=True)]
    except TrajectoryError:
        return _without_interval(*tables)
    centre, spread = mean_difference(compared)
    half = upper_95(max(int(spread.freedom), 1)) * math.sqrt(spread.variance)
    low, high = (1 - math.exp(min(centre + side * half, _LARGEST_LOG)) for side in (1, -1))
    return Improvement(1 - math.exp(centre), low, high, sum(table.shape[1] for table in compared))


def _without_interval(nominal: "Sequence[FloatArray]", best: "Sequence[FloatArray]") -> Improvement:
    """Return the improvement over the first noisy runs where there are too few of them for more."""
    import numpy as np

    with np.errstate(divide="ignore", invalid="ignore"):
        logs = [np.log(b[:, :1]) - np.log(a[:, :1]) for a, b in zip(nominal, best, strict=True) if a.shape == b.shape]
    means = [float(one.mean()) for one in logs]
    if len(means) < len(nominal) or not all(map(math.isfinite, means)):
        return UNKNOWN_IMPROVEMENT
    return Improvement(1 - math.exp(sum(means) / len(means)), math.nan, math.nan, 1)


def _matrices(detail: Mapping[str, Any]) -> "list[FloatArray]":
    """Return the (k, k_delta) errors of a trial on each sequence; nothing where it has none on one of them."""
    import numpy as np

    stored = [one.get("matrix") for one in detail.get("sequences", {}).values()]
    if not stored or not all(stored):
        return []
    return [np.array(one, dtype=np.float64) for one in stored]  # None becomes NaN


def rank_correlation(pairs: Sequence[tuple[float, float]]) -> float:
    """Return Spearman's rank correlation of pairs; NaN for fewer than three."""
    if len(pairs) < 3:
        return math.nan
    from scipy import stats  # takes a second to import

    first, second = zip(*pairs, strict=True)
    return float(stats.spearmanr(first, second).statistic)
