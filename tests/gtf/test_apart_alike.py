"""Runs that fall into another solution under every configuration alike say nothing about the choice."""

import numpy as np

from gtf_tune.gtf.random_effects import clean_runs_apart, compared_table

GENERATOR = np.random.default_rng(3)


def _errors(k: int = 2, noisy: int = 8, gain: float = 1.0) -> np.ndarray:
    return gain * 0.002 * np.exp(0.1 * GENERATOR.normal(size=(k, noisy)))


def test_a_clean_run_of_another_solution_is_found_where_it_is_one_of_two() -> None:
    before, after = _errors(), _errors(gain=0.6)
    before[1], after[1] = 0.93, 0.91

    assert clean_runs_apart([before, after]).tolist() == [False, True]


def test_a_clean_run_that_diverged_under_one_configuration_only_is_that_ones_fault() -> None:
    before, after = _errors(), _errors()
    after[1] = 0.93

    assert not clean_runs_apart([before, after]).any()


def test_a_clean_run_that_failed_is_none_of_another_solution() -> None:
    before, after = _errors(), _errors()
    before[1] = np.nan

    assert not clean_runs_apart([before, after]).any()


def test_noise_that_breaks_both_configurations_is_left_out_of_their_comparison() -> None:
    before = _errors()
    after = 0.6 * before
    for broken in (before, after):
        broken[:, 5] = 0.9

    table, left_out = compared_table(before, after)

    assert left_out.tolist() == [False] * 5 + [True] + [False] * 2
    np.testing.assert_allclose(table, np.log(0.6))
