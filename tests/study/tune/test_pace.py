"""The minutes are kept, and the time left that is said is near what it turns out to be, whatever runs really take."""

import itertools
import math
from dataclasses import dataclass

import pytest

from gtf_tune.study.tune.budget import (
    AROUND_S,
    CLEAN_RUNS,
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
    configuration(whole, 4)
    pace.trial_done()
    while not pace.search_is_over:
        configuration(repeated, 4)
        clock.seconds += 0.05 * repeated
        pace.trial_done()
    while pace.may_shorten and pace.done < plan.trials + 2:
        configuration(repeated, 4)
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
    for _ in range(4):
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
    for _ in range(4):
        clock.seconds += 60.0
        pace.run_done()
    before = pace.left_s
    pace.trial_done()

    assert before == pytest.approx(pace.left_s, rel=0.05)


@pytest.mark.parametrize("jobs", [1, 2])
@pytest.mark.parametrize("slowness", [1.0, 1.5, 2.5, 4.0])
@pytest.mark.parametrize("share", [1 / 8, 1 / 5, 1 / 3])
def test_no_run_of_a_trial_is_begun_that_cannot_end_in_time(share: float, slowness: float, jobs: int) -> None:
    seconds, clock = 360.0, Clock()
    price, full = RunPrice(share * seconds, share * seconds / 4), RunPrice(0.0, 20.0)
    budget = Budget(seconds, jobs, 7, noisy=1, stored=1)
    pace = Pace(budget.plan_at(full, price, REDUCTIONS[0]), budget, now=clock)
    pace.run_done(reused=True)

    def trial(cost: float, runs: int) -> bool:
        while runs and not pace.trial_is_hopeless and pace.work_left_s > 0:
            together = min(jobs, runs)
            clock.seconds += min(cost, pace.work_left_s)  # the clock stops what is in flight
            for _ in range(together):
                pace.run_done()
            runs -= together
        return not runs

    if not pace.search_is_over and trial(slowness * price.whole_s, budget.nominal_runs):
        pace.trial_done()
        while not pace.search_is_over and trial(slowness * price.repeated_s, budget.copies):
            pace.trial_done()

    assert pace.deadline_left_s >= AROUND_S
    assert pace.done <= 1 or pace.deadline_left_s >= AROUND_S + full.repeated_s
    assert slowness > 1 or pace.done >= 2


def test_a_trial_whose_runs_are_slow_is_given_up_before_the_time_is_spent() -> None:
    budget, clock = Budget(360.0, 1, 7), Clock()
    pace = Pace(budget.plan_at(RunPrice(0.0, 20.0), RunPrice(40.0, 5.0), REDUCTIONS[0]), budget, now=clock)
    clock.seconds += 160.0
    pace.run_done()

    assert pace.trial_is_hopeless
    assert pace.work_left_s > 100


def test_a_search_whose_nominal_trial_cannot_end_does_not_begin() -> None:
    price = RunPrice(120.0, 40.0)
    plan = Budget(3600, 2, 7).plan_at(RunPrice(0.0, 60.0), price, REDUCTIONS[0])
    late, in_time = (Pace(plan, Budget(seconds, 2, 7), now=Clock()) for seconds in (300.0, 500.0))

    assert late.search_is_over
    assert not in_time.search_is_over
