"""What a number of minutes buys."""

import pytest
from hypothesis import given
from hypothesis import strategies as st

from gtf_tune.study.tune.budget import (
    FEWEST_CONFIRMATION_RUNS,
    MOST_TRIALS,
    REDUCTIONS,
    Budget,
    Reduction,
    RunPrice,
)

FIRST = 7


def budget(minutes: float, jobs: int = 1) -> Budget:
    return Budget(60 * minutes, jobs, FIRST)


def test_time_without_end_buys_everything_on_all_images() -> None:
    plan = budget(10_000).plan(RunPrice(10.0, 3.0))

    assert (plan.trials, plan.reduction) == (MOST_TRIALS, Reduction())


def test_too_little_time_shrinks_the_images_first_and_then_takes_fewer() -> None:
    price = RunPrice(60.0, 15.0)

    assert [budget(minutes).plan(price).reduction for minutes in (60, 20, 6, 2)] == list(REDUCTIONS)


def test_the_first_configurations_are_tried_even_where_there_is_no_time_for_more() -> None:
    plan = budget(0.1).plan(RunPrice(60.0, 15.0))

    assert (plan.trials, plan.confirmation_runs) == (1 + FIRST, 0)


def test_more_jobs_buy_more_trials() -> None:
    price = RunPrice(10.0, 4.0)

    assert budget(15, jobs=2).plan(price).trials > budget(15).plan(price).trials


def test_a_measured_price_keeps_the_reduction_that_it_was_measured_on() -> None:
    plan = budget(30).plan(RunPrice(100.0, 40.0), RunPrice(8.0, 2.0), REDUCTIONS[3])

    assert plan.reduction == REDUCTIONS[3]
    assert plan.write_s == pytest.approx(200.0)


@given(st.floats(1, 600), st.integers(1, 16), st.floats(1, 300), st.floats(0.01, 1))
def test_a_plan_with_a_confirmation_ends_within_the_minutes(
    minutes: float, jobs: int, whole_s: float, share: float
) -> None:
    plan = budget(minutes, jobs).plan(RunPrice(whole_s, share * whole_s))

    assert plan.trials >= 1 + FIRST
    if plan.confirmation_runs:
        assert plan.confirmation_runs >= FEWEST_CONFIRMATION_RUNS
        assert plan.seconds <= 60 * minutes


@given(st.floats(1, 600), st.floats(1, 300), st.floats(0.01, 1))
def test_more_minutes_never_buy_fewer_images(minutes: float, whole_s: float, share: float) -> None:
    price = RunPrice(whole_s, share * whole_s)

    less, more = budget(minutes).plan(price).reduction, budget(2 * minutes).plan(price).reduction

    assert REDUCTIONS.index(more) <= REDUCTIONS.index(less)
