"""On which images is searched, and whether anything can be compared, is settled before the time is spent."""

from dataclasses import dataclass, field

import pytest

from gtf_tune.study.tune.budget import REDUCTIONS, Budget, Plan, Reduction, RunPrice
from gtf_tune.study.tune.choice import TooLittleTime, choose

FULL, HALF, FEW, FEWEST = REDUCTIONS
CHEAP_MODEL = RunPrice(20.0, 10.0)


@dataclass
class Machine:
    """Prices by the number of pixels, on a clock that runs while something is timed."""

    whole_s: float
    seconds: float
    refused: frozenset[Reduction] = frozenset()
    slowness: float = 1.0
    of_model: Reduction = FULL
    timed: list[Reduction] = field(default_factory=list)

    @property
    def reductions(self) -> tuple[Reduction, ...]:
        return REDUCTIONS

    def left_s(self) -> float:
        return self.seconds

    def price(self, reduction: Reduction) -> RunPrice:
        guessed = RunPrice(self.whole_s, self.whole_s / 4).times(reduction.frames * reduction.size**2)
        return guessed.times(self.slowness) if reduction in self.timed else guessed

    def measured(self, reduction: Reduction) -> RunPrice:
        if reduction not in self.timed:
            self.timed.append(reduction)
            self.seconds -= self.price(reduction).whole_s
        return self.price(reduction)

    def misleads(self, reduction: Reduction) -> bool:
        if reduction != self.of_model:
            self.measured(reduction)
        return reduction in self.refused

    def stored(self, reduction: Reduction) -> int:
        return int(reduction in self.timed)


def chosen(machine: Machine, full: RunPrice = CHEAP_MODEL) -> Plan | TooLittleTime:
    return choose(machine, full, Budget(machine.seconds, 2, 7), machine.left_s)


def test_the_largest_images_that_fit_are_timed_and_taken() -> None:
    machine = Machine(whole_s=100.0, seconds=600.0)

    found = chosen(machine)

    assert isinstance(found, Plan)
    assert machine.timed == [found.reduction] == [HALF]


def test_refused_images_lead_to_others_as_long_as_there_is_time() -> None:
    machine = Machine(100.0, 600.0, refused=frozenset([HALF]))

    found = chosen(machine)

    assert isinstance(found, Plan)
    assert (found.reduction, machine.timed) == (FEW, [HALF, FEW])


def test_where_all_reduced_images_are_refused_a_nominal_run_of_a_third_of_the_time_is_not_begun() -> None:
    machine = Machine(100.0, 300.0, refused=frozenset([HALF, FEW, FEWEST]))

    found = chosen(machine, RunPrice(100.0, 60.0))

    assert isinstance(found, TooLittleTime)
    assert FULL not in machine.timed
    assert machine.seconds > 200
    assert found.minutes == 7


@pytest.mark.parametrize(("minutes", "compares"), [(5, False), (8, True)])
def test_the_minutes_that_are_named_suffice(minutes: int, compares: bool) -> None:
    machine = Machine(100.0, 60.0 * minutes, refused=frozenset([HALF, FEW, FEWEST]))

    assert isinstance(chosen(machine, RunPrice(100.0, 60.0)), Plan) is compares


def test_runs_that_take_longer_than_guessed_are_noticed_before_the_search() -> None:
    machine = Machine(40.0, 200.0, refused=frozenset([HALF, FEW, FEWEST]), slowness=3.0)

    found = chosen(machine)

    assert isinstance(found, TooLittleTime)
    assert FULL in machine.timed
    assert found.spent_s + found.more_s > 200


def test_a_plan_leaves_time_for_another_trial_and_its_model() -> None:
    for seconds in range(60, 900, 20):
        machine = Machine(60.0, float(seconds), refused=frozenset([FEWEST]))
        found = chosen(machine)
        if isinstance(found, Plan):
            assert found.trials >= 2
            assert found.seconds <= machine.seconds
