"""The minutes are kept, and the time left that is said is near what it turns out to be, whatever runs really take."""

import itertools
import math
from dataclasses import dataclass

import pytest

from gtf_tune.study.tune.budget import (
    AROUND_S,
    CLEAN_RUNS,
    COPIES,
    FEWEST_CONFIRMATION_RUNS,
    REDUCTIONS,
    Budget,
    Plan,
    RunPrice,
)
from gtf_tune.study.tune.pace import CONFIRM, WRITE, Pace

PRICE = RunPrice(20.0, 5.0, 12.0)


class Clock:
    def __init__(self) -> None:
        self.seconds = 0.0

    def __call__(self) -> float:
        return self.seconds


@dataclass
class Machine:
    """A machine on which whole runs and repeated ones take so many times as long as planned."""

    whole: float = 1.0
    repeated: float = 1.0
    second_s: float = 40.0


@dataclass
class Course:
    """What was said to be left and when, when all was over, and what was made."""

    said: list[tuple[float, float]]
    end: float
    trials: int
    confirmation_runs: int

    def ratio(self, share: float) -> float:
        """Return what was said over what was left, at a share of the way."""
        at, left = [one for one in self.said if one[0] <= share * self.end][-1]
        return left / (self.end - at)

    def jump(self) -> float:
        """Return by how many times what is said jumps between two runs of the first trials, at most."""
        left = [left for _, left in self.said[1:12]]
        return max(max(one, other) / min(one, other) for one, other in itertools.pairwise(left))


def simulated(minutes: float, machine: Machine, price: RunPrice = PRICE, jobs: int = 1) -> Course:
    """Go through all phases as the command does, run by run."""
    budget = Budget(60 * minutes, jobs, 7, baselines=1)
    clock, full = Clock(), RunPrice(0.0, machine.second_s)
    plan = budget.plan_at(full, price, REDUCTIONS[1])
    pace = Pace(plan, budget, now=clock)
    said: list[tuple[float, float]] = []

    def configuration(cost: float, runs: int) -> None:
        for wave in range(math.ceil(runs / jobs)):
            clock.seconds += cost
            for _ in range(min(jobs, runs - wave * jobs)):
                pace.run_done()
            said.append((clock.seconds, pace.left_s))

    whole, repeated = machine.whole * price.whole_s, machine.repeated * price.repeated_s
    configuration(whole, COPIES)
    pace.trial_done()
    while not pace.search_is_over:
        configuration(repeated, COPIES)
        clock.seconds += 0.05 * repeated
        pace.trial_done()
    while pace.may_shorten and pace.done < plan.trials + 2:
        configuration(repeated, COPIES)
        pace.trial_done()
    trials, ahead = pace.done, pace.ahead
    noisy = ahead.confirmation_runs
    if noisy:
        pace.begin(CONFIRM)
        for cost in (whole, *[repeated] * ahead.candidates, *[machine.whole * price.verified_s] * ahead.baselines):
            configuration(cost, CLEAN_RUNS + noisy)
    pace.begin(WRITE)
    said.append((clock.seconds, pace.left_s))
    return Course(said, clock.seconds + min(machine.repeated, 2.0) * machine.second_s + AROUND_S, trials, noisy)


MACHINES = [
    Machine(),
    Machine(whole=1.5, repeated=1.5),
    Machine(whole=0.6, repeated=0.7),
    Machine(whole=1.0, repeated=1.8),
    Machine(second_s=400.0),
    Machine(whole=1.3, repeated=1.3, second_s=300.0),
]


@pytest.mark.parametrize("machine", MACHINES)
@pytest.mark.parametrize("minutes", [15, 30, 90])
@pytest.mark.parametrize("jobs", [1, 2])
def test_the_minutes_are_kept_and_the_time_left_is_within_30_per_cent(
    machine: Machine, minutes: float, jobs: int
) -> None:
    course = simulated(minutes, machine, jobs=jobs)

    assert course.end <= 1.02 * 60 * minutes
    assert minutes < 30 or course.confirmation_runs >= FEWEST_CONFIRMATION_RUNS
    for share in (0.25, 0.5, 0.75):
        assert course.ratio(share) == pytest.approx(1.0, rel=0.3)
    assert course.jump() < 1.3


def test_where_all_runs_are_slower_the_search_is_shortened_before_the_confirmation() -> None:
    planned, slower = (simulated(15, Machine(factor, factor)) for factor in (1.0, 2.0))

    assert slower.trials < planned.trials
    assert slower.confirmation_runs >= FEWEST_CONFIRMATION_RUNS


def test_too_few_minutes_end_without_a_confirmation_but_in_time() -> None:
    course = simulated(5, Machine(second_s=60.0), RunPrice(30.0, 6.0, 15.0))

    assert course.confirmation_runs == 0
    assert course.end <= 60 * 5


def test_runs_that_were_stored_before_say_nothing_about_the_pace() -> None:
    plan = Plan(10, 4, REDUCTIONS[0], 0.0, 0.0, 0.0, PRICE, RunPrice(0.0, 0.0))
    pace = Pace(plan, Budget(1e9, 1, 7), now=Clock())
    before = pace.price
    for _ in range(COPIES):
        pace.run_done(reused=True)
    pace.trial_done()

    assert pace.price == before


def test_a_study_that_goes_on_owes_no_nominal_trial() -> None:
    plan = Plan(10, 4, REDUCTIONS[0], 0.0, 0.0, 0.0, PRICE, RunPrice(0.0, 0.0))
    begun, anew = (Pace(plan, Budget(3600, 1, 7), done, now=Clock()) for done in (5, 0))

    assert begun.ahead.trials == 5
    assert begun.left_s < anew.left_s


def test_runs_of_the_nominal_trial_are_not_owed_again_while_it_is_under_way() -> None:
    budget, clock = Budget(620.0, 1, 7), Clock()
    plan = budget.plan_at(RunPrice(0.0, 20.0), RunPrice(60.0, 10.0, 30.0), REDUCTIONS[3])
    pace = Pace(plan, budget, now=clock)
    for _ in range(COPIES):
        clock.seconds += 60.0
        pace.run_done()
    before = pace.left_s
    pace.trial_done()

    assert before == pytest.approx(pace.left_s, rel=0.05)
