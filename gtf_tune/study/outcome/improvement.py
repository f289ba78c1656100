"""How much better one trial is than nominal: one number with its interval, stored when the trial ends."""

import math
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from typing import Any, Self

from gtf_tune.display import UNKNOWN, count, percent
from gtf_tune.store import trials
from gtf_tune.store.database import Database
from gtf_tune.store.trials import Trial

_STORED_AS = "improvement"


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
    comparable = [one for one in chosen if one.feasible and one.number]
    nominal = trials.nominal(database, study_id) if comparable else None
    if nominal is None or not nominal.feasible:
        return {}
    details = trials.details(database, [one.id for one in comparable])
    if any(_STORED_AS not in detail for detail in details.values()):
        details |= trials.details(database, [nominal.id])
    return {one.number: improvement_of(details[one.id], details.get(nominal.id, {})) for one in comparable}


def improvement_of(detail: Mapping[str, Any], nominal: Mapping[str, Any]) -> Improvement:
    """Return the improvement that is stored with a trial.

    A trial that an earlier version stored lacks it. Then it is computed from the matrices of the trial and of nominal,
    which takes a second for the imports.
    """
    if _STORED_AS in detail:
        return Improvement.from_json(detail[_STORED_AS])
    from gtf_tune.study.outcome.pairing import paired_improvement, stored_matrices

    return paired_improvement(stored_matrices(nominal), stored_matrices(detail))


def known(value: float) -> float | None:
    """Return a number as JSON has it, None for NaN and infinity."""
    return value if math.isfinite(value) else None


def nan_if_none(stored: float | None) -> float:
    """Return a stored number, NaN for None."""
    return math.nan if stored is None else float(stored)
