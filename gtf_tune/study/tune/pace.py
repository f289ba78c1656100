"""How long everything still takes, in one number for all phases.

The plan says what each run costs. How much slower or faster this machine is than planned is seen from the runs that
have ended, and scales what is left.
"""

import time
from collections.abc import Callable
from dataclasses import dataclass, field

from gtf_tune.study.tune.budget import CLEAN_RUNS, CONFIRMED, NOISY_RUNS, Plan

_PRIOR = 0.05
"""Weight of the plan against what was seen, as a share of all work."""


def work_of(plan: Plan, baselines: int) -> dict[str, list[float]]:
    """Return what is to be done by phase: what each run costs, in seconds of one core and in running order."""
    copies, fresh, price = CLEAN_RUNS + NOISY_RUNS, CLEAN_RUNS + plan.confirmation_runs, plan.price
    repeated = [price.repeated_s] * (plan.trials - 1) * copies
    confirmed = (
        [price.whole_s] * fresh + [price.repeated_s] * CONFIRMED * fresh + [price.verified_s] * baselines * fresh
    )
    return {
        "search": [price.whole_s] * copies + repeated,
        "confirm": confirmed if plan.confirmation_runs else [],
        "write": [plan.full.whole_s, plan.full.verified_s or plan.full.whole_s],
    }


@dataclass
class Pace:
    """Time that is left, from the costs of runs by phase and the runs that have ended.

    ``deadline_s`` is the whole wall time from the making of this object. What comes before the last phase ends in time
    for that one, which takes as long as it takes: its runs go one at a time, those of the others ``jobs`` at a time.
    """

    work: dict[str, list[float]]
    jobs: int
    deadline_s: float
    now: Callable[[], float] = time.monotonic
    _began: float = field(init=False)
    _phase_began: float = field(init=False)
    phase: str = field(init=False, default="search")
    _planned_s: float = field(init=False, default=0.0)
    _taken_s: float = field(init=False, default=0.0)
    _done: int = field(init=False, default=0)

    def __post_init__(self) -> None:
        self._began = self._phase_began = self.now()

    def begin(self, phase: str) -> None:
        """Begin a phase; what was left of the one before is not done any more."""
        self._taken_s += self.now() - self._phase_began
        self._phase_began, self.phase, self._done = self.now(), phase, 0

    def run_done(self, *, reused: bool = False) -> None:
        """Count a run of this phase; one that was stored before took no time."""
        costs = self.work[self.phase]
        if self._done < len(costs) and not reused:
            self._planned_s += costs[self._done] / self._side_by_side(self.phase)
        self._done += 1

    @property
    def deadline_left_s(self) -> float:
        """Seconds until the deadline; negative after it."""
        return self.deadline_s - (self.now() - self._began)

    @property
    def slowness(self) -> float:
        """How many times longer runs take than planned."""
        prior = _PRIOR * sum(self._phase_s(phase, 0) for phase in self.work)
        if prior <= 0:
            return 1.0
        taken = self._taken_s + (self.now() - self._phase_began if self._done else 0.0)
        return (taken + prior) / (self._planned_s + prior)

    @property
    def left_s(self) -> float:
        """Seconds that everything still takes."""
        *phases, last = self.work
        if self.phase == last:
            return self.slowness * self._phase_s(last, self._done)
        later = phases[phases.index(self.phase) + 1 :]
        runs = self._phase_s(self.phase, self._done) + sum(self._phase_s(phase, 0) for phase in later)
        write_s = self.slowness * self._phase_s(last, 0)
        return min(self.slowness * runs, max(self.deadline_left_s - write_s, 0.0)) + write_s

    def _phase_s(self, phase: str, done: int) -> float:
        return sum(self.work[phase][done:]) / self._side_by_side(phase)

    def _side_by_side(self, phase: str) -> int:
        return 1 if phase == list(self.work)[-1] else self.jobs
