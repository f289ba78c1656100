"""How much better one trial is than nominal: one number with its interval, stored when the trial ends."""

import math
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Self

from gtf_tune.display import UNKNOWN, count, percent
from gtf_tune.errors import TrajectoryError
from gtf_tune.store import trials
from gtf_tune.store.database import Database
from gtf_tune.store.trials import Trial

if TYPE_CHECKING:  # readers of what is stored need neither numpy nor scipy
    from gtf_tune.study.scoring.objective import TrialScore
    from gtf_tune.trajectory import FloatArray

    Matrices = Mapping[str, FloatArray]

_STORED_AS = "improvement"
_LARGEST_LOG = 700.0


@dataclass(frozen=True)
class Improvement:
    """How much smaller the errors of a trial are than those of nominal, paired by noise instance.

    Attributes
    ----------
    value
        Fraction of nominal's error, positive where the trial is better; NaN where the two cannot be compared.
    low, high
        Its 95 % confidence interval, NaN with fewer than two noise instances that worked under both. For a trial of the
        search it is optimistic: it does not account for the trial having been picked as the best of many.
    instances
        Noise instances that were compared, over all sequences.
    """

    value: float
    low: float
    high: float
    instances: int

    @property
    def is_known(self) -> bool:
        """Whether the trial could be compared with nominal."""
        return math.isfinite(self.value)

    @property
    def is_certain(self) -> bool:
        """Whether the whole interval lies on the better side."""
        return self.low > 0

    @property
    def change(self) -> str:
        """The signed change of the error in per cent, negative where the trial is better: ``-27.1 %``."""
        return percent(-self.value)

    @property
    def bounds(self) -> str:
        """The 95 % interval of the change: ``-33.0 % to -20.2 %``."""
        return f"{percent(-self.high)} to {percent(-self.low)}" if math.isfinite(self.low) else UNKNOWN

    @property
    def text(self) -> str:
        """The change with its interval and what it is based on."""
        if not self.is_known:
            return UNKNOWN
        if not math.isfinite(self.low):
            return f"{self.change} ({count(self.instances, 'noisy run')}: no interval)"
        return f"{self.change} (95 % interval {self.bounds}, {count(self.instances, 'noisy run')})"

    def as_json(self) -> dict[str, float | int | None]:
        """Return the form in which a trial stores it."""
        return {**{name: known(getattr(self, name)) for name in ("value", "low", "high")}, "instances": self.instances}

    @classmethod
    def from_json(cls, stored: Mapping[str, Any]) -> Self:
        """Return the improvement that `as_json` wrote."""
        value, low, high = (nan_if_none(stored.get(name)) for name in ("value", "low", "high"))
        return cls(value, low, high, int(stored.get("instances") or 0))


UNKNOWN_IMPROVEMENT = Improvement(math.nan, math.nan, math.nan, 0)


def read_improvements(database: Database, study_id: int, chosen: Iterable[Trial]) -> dict[int, Improvement]:
    """Return the improvements of some trials of a study by number; infeasible ones and nominal are left out."""
    comparable = [trial for trial in chosen if trial.feasible and trial.number]
    nominal = trials.nominal(database, study_id) if comparable else None
    if nominal is None or not nominal.feasible:
        return {}
    details = trials.details(database, [trial.id for trial in comparable])
    if any(_STORED_AS not in detail for detail in details.values()):
        details |= trials.details(database, [nominal.id])
    return {trial.number: improvement_of(details[trial.id], details.get(nominal.id, {})) for trial in comparable}


def improvement_of(detail: Mapping[str, Any], nominal: Mapping[str, Any]) -> Improvement:
    """Return the improvement that is stored with a trial.

    A trial that an earlier version stored lacks it. Then it is computed from the matrices of the trial and of nominal,
    which takes a second for the imports.
    """
    if _STORED_AS in detail:
        return Improvement.from_json(detail[_STORED_AS])
    return paired_improvement(stored_matrices(nominal), stored_matrices(detail))


def known(value: float) -> float | None:
    """Return a number as JSON has it, None for NaN and infinity."""
    return value if math.isfinite(value) else None


def nan_if_none(stored: float | None) -> float:
    """Return a stored number, NaN for None."""
    return math.nan if stored is None else float(stored)


def paired_improvement(nominal: "Matrices", other: "Matrices") -> Improvement:
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
    from gtf_tune.gtf.aggregate import half_width
    from gtf_tune.gtf.random_effects import compared_table, mean_difference

    if not nominal or nominal.keys() != other.keys():
        return UNKNOWN_IMPROVEMENT
    pairs = [(nominal[name], other[name]) for name in nominal]
    if not all(matrix.size for pair in pairs for matrix in pair):
        return UNKNOWN_IMPROVEMENT
    try:
        tables = [compared_table(*pair)[0] for pair in pairs]
    except TrajectoryError:
        return _without_interval(pairs)
    center, spread = mean_difference(tables)
    half = half_width(spread)
    low, high = (1 - math.exp(min(center + side * half, _LARGEST_LOG)) for side in (1, -1))
    return Improvement(1 - math.exp(center), low, high, sum(table.shape[1] for table in tables))


def stored_matrices(detail: Mapping[str, Any]) -> "dict[str, FloatArray]":
    """Return the (k, k_delta) errors by sequence from what is stored with a trial; empty where it has none."""
    import numpy as np

    stored = {name: sequence.get("matrix") for name, sequence in detail.get("sequences", {}).items()}
    if not all(stored.values()):
        return {}
    return {name: np.array(matrix, dtype=np.float64) for name, matrix in stored.items()}  # None becomes NaN


def score_matrices(score: "TrialScore") -> "dict[str, FloatArray]":
    """Return the (k, k_delta) errors by sequence of a trial that may be used; empty where it is infeasible."""
    if not score.feasible:
        return {}
    return {name: sequence.score.matrix for name, sequence in score.by_sequence.items() if sequence.score is not None}


def _without_interval(pairs: "list[tuple[FloatArray, FloatArray]]") -> Improvement:
    """Return the improvement over the first noisy runs where there are too few of them for more."""
    import numpy as np

    if any(len(first) != len(second) for first, second in pairs):
        return UNKNOWN_IMPROVEMENT
    with np.errstate(divide="ignore", invalid="ignore"):
        means = [float((np.log(second[:, :1]) - np.log(first[:, :1])).mean()) for first, second in pairs]
    if not all(map(math.isfinite, means)):
        return UNKNOWN_IMPROVEMENT
    return Improvement(1 - math.exp(sum(means) / len(means)), math.nan, math.nan, 1)
