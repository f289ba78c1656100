"""How much is still to be done within the minutes, and how long it takes, from what runs were planned to cost and took.

Whole runs and repeated ones are measured apart: other options than nominal's may make mapping slower, and several runs
side by side slow each other down.
"""

import time
from collections.abc import Callable
from dataclasses import dataclass, field, replace

from gtf_tune.study.tune.budget import AROUND_S, Ahead, Budget, Plan, RunPrice

_PRIOR_RUNS = 2.0
"""How many runs the planned price of a run counts for against measured ones."""

SEARCH, CONFIRM, WRITE = "search", "confirm", "write"


@dataclass
class _Seen:
    """Planned and real seconds of the runs of one kind that have ended."""

    planned_s: float = 0.0
    taken_s: float = 0.0

    def slowness(self, unit_s: float) -> float:
        """Return how many times longer than planned they take; ``unit_s`` is the planned price of one."""
        prior = _PRIOR_RUNS * unit_s
        return (self.taken_s + prior) / (self.planned_s + prior) if prior > 0 else 1.0


@dataclass
class Pace:
    """Work that is left and its time, within the seconds of ``budget`` from the making of this object.

    ``done`` trials had ended before, nominal among them.
    """

    plan: Plan
    budget: Budget
    done: int = 0
    now: Callable[[], float] = time.monotonic
    phase: str = field(init=False, default=SEARCH)
    _began: float = field(init=False)
    _mark: float = field(init=False)
    _runs: int = field(init=False, default=0)
    _confirmation: Ahead | None = field(init=False, default=None)
    _whole: _Seen = field(init=False, default_factory=_Seen)
    _repeated: _Seen = field(init=False, default_factory=_Seen)

    def __post_init__(self) -> None:
        self._began = self._mark = self.now()

    @property
    def deadline_left_s(self) -> float:
        """Seconds until the deadline; negative after it."""
        return self.budget.seconds - (self.now() - self._began)

    @property
    def price(self) -> RunPrice:
        """What a run of the search costs, as planned but for the pace that was seen."""
        planned = self.plan.price
        whole, repeated = self._whole.slowness(planned.whole_s), self._repeated.slowness(planned.repeated_s)
        return RunPrice(whole * planned.whole_s, repeated * planned.repeated_s, whole * planned.verified_s)

    @property
    def ahead(self) -> Ahead:
        """What can still be done from here."""
        full = self.plan.full
        slower = min(max(self._repeated.slowness(self.plan.price.repeated_s), 1.0), 2.0)
        full = replace(full, repeated_s=slower * full.repeated_s)
        wanted = (self.plan.trials, self.plan.confirmation_runs)
        return self.budget.ahead(self.price, full, self.deadline_left_s + self._begun_s, wanted, done=self.done)

    @property
    def _begun_s(self) -> float:
        """Seconds of the trial under way that its ended runs stand for."""
        if self.phase != SEARCH:
            return 0.0
        ended, runs = self._runs_made
        return min(ended / runs, 1.0) * self._trial_s if runs else 0.0

    @property
    def _trial_s(self) -> float:
        """Seconds of the trial under way, from its first run to its last."""
        return self.budget.trial_s(self.price) if self.done else self.budget.nominal_s(self.price)

    @property
    def _runs_made(self) -> tuple[int, int]:
        """Runs of the trial under way that have ended, and all of them, without those that were stored before."""
        if self.done:
            return self._runs, self.budget.copies
        return max(self._runs - self.budget.stored, 0), self.budget.nominal_runs

    @property
    def search_is_over(self) -> bool:
        """Whether there is no time for a further trial; for nominal's, none for it and another one."""
        if self.done:
            return self.ahead.trials == 0
        return self.least_s > self.deadline_left_s + self._begun_s

    @property
    def least_s(self) -> float:
        """Seconds without which nothing is compared."""
        price = self.price
        return self.budget.nominal_s(price) + self.budget.trial_s(price) + self.plan.full.repeated_s

    @property
    def work_left_s(self) -> float:
        """Seconds until what was found has to be written: with a trial beside nominal a model is made."""
        full, confirmed = self.plan.full, self._confirmation
        model_s = self.budget.model_s(full) if confirmed and confirmed.baselines else full.repeated_s
        return self.deadline_left_s - AROUND_S - (model_s if self.done else 0.0)

    @property
    def trial_is_hopeless(self) -> bool:
        """Whether the trial under way cannot end in time, by what runs take."""
        return self.phase == SEARCH and self._runs > 0 and self._trial_s - self._begun_s > self.work_left_s

    @property
    def may_shorten(self) -> bool:
        """Whether there is time for a trial that puts an option back to nominal, and the confirmation after it."""
        return self.ahead.search_s > 0

    @property
    def left_s(self) -> float:
        """Seconds that everything still takes."""
        ahead = self.ahead
        if self.phase == WRITE:
            return max(ahead.write_s - (self.now() - self._mark), 0.0)
        if self.phase == CONFIRM:
            return self._confirmation_left_s() + ahead.write_s
        return max(ahead.search_s - self._begun_s, 0.0) + ahead.confirm_s + ahead.write_s

    def begin(self, phase: str) -> None:
        """Begin a phase; what was left of the one before is not done any more."""
        self._confirmation = self.ahead if phase == CONFIRM else None
        self.phase, self._mark, self._runs = phase, self.now(), 0

    def run_done(self, *, reused: bool = False) -> None:
        """Count a run of this phase; one that was stored before took no time."""
        kind, unit_s = self._kind()
        runs = self._runs_made[1] if self.phase == SEARCH else self._fresh
        self._runs += 1
        if kind and runs and not reused:
            kind.planned_s += unit_s * self.budget.waves(runs) / runs
            kind.taken_s += self.now() - self._mark
        self._mark = self.now()

    def trial_done(self) -> None:
        """Count a trial of the search; the time between its last run and now belongs to its runs."""
        kind, _ = self._kind()
        if kind and kind.planned_s:
            kind.taken_s += self.now() - self._mark
        self._mark, self._runs = self.now(), 0
        self.done += 1

    @property
    def _fresh(self) -> int:
        """Runs of each configuration in the confirmation under way."""
        return self.budget.clean + (self._confirmation.confirmation_runs if self._confirmation else 0)

    def _kind(self) -> tuple[_Seen | None, float]:
        """Return what the next run that ends is one of, and its planned price; None for runs of a baseline."""
        price = self.plan.price
        is_nominal = not self.done if self.phase == SEARCH else self._runs < self._fresh
        if is_nominal:
            return self._whole, price.whole_s
        if self._confirmation is None or self._runs < (1 + self._confirmation.candidates) * self._fresh:
            return self._repeated, price.repeated_s
        return None, 0.0

    def _confirmation_left_s(self) -> float:
        price, plan = self.price, self._confirmation
        if plan is None or not plan.confirmation_runs:
            return 0.0
        each = [price.whole_s, *[price.repeated_s] * plan.candidates, *[price.verified_s] * plan.baselines]
        finished = self._runs / self._fresh
        left = sum(cost * min(max(place + 1 - finished, 0.0), 1.0) for place, cost in enumerate(each))
        return self.budget.waves(self._fresh) * left
