"""What a number of minutes buys."""

from dataclasses import replace

import pytest
from hypothesis import given
from hypothesis import strategies as st

from gtf_tune.study.tune.budget import (
    AROUND_S,
    FEWEST_CONFIRMATION_RUNS,
    FEWEST_TRIALS,
    MOST_CONFIRMATION_RUNS,
    MOST_TRIALS,
    REDUCTIONS,
    Budget,
    Plan,
    Reduction,
    RunPrice,
)

FIRST = 7
SMALL = RunPrice(1.0, 0.3)


def budget(minutes: float, jobs: int = 1) -> Budget:
    return Budget(60 * minutes, jobs, FIRST)


def plan(minutes: float, price: RunPrice, jobs: int = 1) -> Plan:
    """Return the plan where prices go with the number of pixels."""
    return budget(minutes, jobs).plan(price, lambda to: price.times(to.frames * to.size**2))


def test_time_without_end_buys_everything_on_all_images() -> None:
    found = plan(10_000, RunPrice(10.0, 3.0))

    assert (found.trials, found.reduction) == (MOST_TRIALS, Reduction())
    assert found.confirmation_runs == MOST_CONFIRMATION_RUNS


def test_too_little_time_shrinks_the_images_first_and_then_takes_fewer() -> None:
    price = RunPrice(60.0, 15.0)

    assert [plan(minutes, price).reduction for minutes in (40, 10, 4, 1)] == list(REDUCTIONS)


def test_trials_have_one_noisy_run_before_images_are_left_out() -> None:
    bought = [plan(minutes, RunPrice(60.0, 15.0)) for minutes in (40, 20)]

    assert [(found.reduction, found.noisy) for found in bought] == [(Reduction(), 3), (Reduction(), 1)]
    assert bought[1].confirmation_runs == FEWEST_CONFIRMATION_RUNS
    kept = replace(budget(20), fewest_noisy=3).plan(RunPrice(60.0, 15.0), lambda to: RunPrice(60.0, 15.0))
    assert kept.noisy == 3


def test_runs_of_nominal_that_are_stored_are_not_paid_again() -> None:
    price = RunPrice(60.0, 15.0)

    assert [replace(budget(9, jobs=2), stored=stored).nominal_s(price) for stored in (0, 2, 4)] == [120.0, 60.0, 0.0]


def test_little_time_shortens_the_search_then_the_confirmation_and_then_leaves_it_out() -> None:
    bought = [budget(minutes).plan_at(SMALL, RunPrice(20.0, 6.0), REDUCTIONS[3]) for minutes in (60, 17, 8, 5)]

    assert (bought[0].trials, bought[0].confirmation_runs) == (MOST_TRIALS, MOST_CONFIRMATION_RUNS)
    assert FIRST < bought[1].trials < MOST_TRIALS
    assert FEWEST_CONFIRMATION_RUNS < bought[1].confirmation_runs < MOST_CONFIRMATION_RUNS
    assert FEWEST_TRIALS <= bought[2].trials <= 1 + FIRST
    assert bought[2].confirmation_runs == FEWEST_CONFIRMATION_RUNS
    assert bought[3].confirmation_runs == 0


def test_a_large_second_reconstruction_is_paid_before_the_search() -> None:
    small, large = (
        budget(20).plan_at(RunPrice(0.0, second_s), RunPrice(2.0, 1.0), REDUCTIONS[3]) for second_s in (10.0, 850.0)
    )

    assert large.trials < small.trials
    assert large.write_s == pytest.approx(850.0 + AROUND_S)
    assert large.seconds <= 20 * 60


def test_more_jobs_buy_more_trials_but_not_beyond_the_runs_of_one() -> None:
    price = RunPrice(10.0, 4.0)

    bought = [budget(7, jobs).plan_at(SMALL, price, Reduction()).trials for jobs in (1, 2, 4, 64)]
    assert bought[0] < bought[1] < bought[2]
    assert budget(12, 64).trial_s(price) == budget(12, 4).trial_s(price)


def test_what_is_left_is_planned_anew_after_trials_that_took_longer() -> None:
    as_planned, slower = (
        budget(30).ahead(RunPrice(20.0, repeated_s), SMALL, 900.0, (MOST_TRIALS, 8), done=9)
        for repeated_s in (4.0, 8.0)
    )

    assert slower.trials < as_planned.trials
    assert (as_planned.confirmation_runs, slower.confirmation_runs) == (8, 8)


@given(
    st.floats(1, 600),
    st.integers(1, 16),
    st.floats(1, 300),
    st.floats(0.01, 1),
    st.floats(0, 1),
    st.sampled_from(REDUCTIONS),
)
def test_a_plan_with_a_confirmation_ends_within_the_minutes(
    minutes: float, jobs: int, whole_s: float, share: float, written: float, reduction: Reduction
) -> None:
    price, full = RunPrice(whole_s, share * whole_s), RunPrice(60 * minutes, 60 * minutes * written)

    found = budget(minutes, jobs).plan_at(full, price, reduction)

    if found.confirmation_runs:
        assert found.confirmation_runs >= FEWEST_CONFIRMATION_RUNS
        assert found.seconds <= 60 * minutes


@given(st.floats(1, 600), st.floats(1, 300), st.floats(0.01, 1))
def test_more_minutes_never_buy_fewer_images(minutes: float, whole_s: float, share: float) -> None:
    price = RunPrice(whole_s, share * whole_s)

    less, more = plan(minutes, price).reduction, plan(2 * minutes, price).reduction

    assert REDUCTIONS.index(more) <= REDUCTIONS.index(less)


def test_a_price_between_two_known_ones_follows_their_power() -> None:
    middle = RunPrice(1.0, 0.1, 0.0).between(RunPrice(100.0, 10.0, 4.0), 0.5)

    assert (middle.whole_s, middle.repeated_s, middle.verified_s) == pytest.approx((10.0, 1.0, 2.0))


def test_time_is_kept_to_verify_matches_anew_where_a_baseline_may_be_adopted() -> None:
    full = RunPrice(100.0, 20.0, 60.0)

    with_baseline, without = (
        Budget(3600, 1, FIRST, baselines).plan_at(full, RunPrice(20.0, 6.0), Reduction()) for baselines in (1, 0)
    )

    assert [plan.write_s - AROUND_S for plan in (with_baseline, without)] == [60.0, 20.0]
