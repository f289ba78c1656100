"""The time left is said for everything together, and follows what runs really take."""

import pytest

from gtf_tune.study.tune.budget import Budget, RunPrice
from gtf_tune.study.tune.pace import Pace, work_of

PRICE = RunPrice(20.0, 5.0, 12.0)


class Clock:
    def __init__(self) -> None:
        self.seconds = 0.0

    def __call__(self) -> float:
        return self.seconds


def simulated(slower: float) -> tuple[list[float], list[float]]:
    """Return what was said to be left after each run, and what really was, where runs take so many times as planned."""
    plan = Budget(3600, 1, 7, baselines=1).plan(PRICE)
    clock = Clock()
    pace = Pace(work_of(plan, 1), 1, deadline_s=1e9, now=clock)
    said, ends = [], []
    for phase, costs in pace.work.items():
        pace.begin(phase)
        for cost in costs:
            clock.seconds += slower * cost
            pace.run_done()
            said.append(pace.left_s)
            ends.append(clock.seconds)
    return said, [ends[-1] - end for end in ends]


@pytest.mark.parametrize("slower", [0.6, 1.0, 2.5])
def test_the_time_left_is_within_30_per_cent_from_a_quarter_of_the_way_on(slower: float) -> None:
    said, truth = simulated(slower)

    total = truth[0]
    for share in (0.25, 0.5, 0.75):
        at = next(index for index, left in enumerate(truth) if left <= (1 - share) * total)
        assert said[at] == pytest.approx(truth[at], rel=0.3)


def test_the_time_left_never_exceeds_the_minutes_but_for_what_has_to_be_written() -> None:
    clock = Clock()
    pace = Pace({"search": [100.0] * 50, "write": [10.0]}, 1, deadline_s=60.0, now=clock)
    clock.seconds = 20.0

    assert pace.left_s == pytest.approx(40.0)
    clock.seconds = 55.0
    assert pace.left_s == pytest.approx(10.0)


def test_runs_that_were_stored_before_say_nothing_about_the_pace() -> None:
    pace = Pace({"search": [10.0] * 10, "write": []}, 1, deadline_s=1e9, now=Clock())
    for _ in range(5):
        pace.run_done(reused=True)

    assert pace.left_s == pytest.approx(50.0)
