import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from gtf_tune.gtf import find_collapsed

DTU = np.array([[383, 1.6, 7.3, 2.3, 1.8, 2.5]]) / 1000


def test_the_collapsed_run_of_dtu_is_the_only_one_found():
    assert find_collapsed(DTU).tolist() == [True, False, False, False, False, False]


@pytest.mark.parametrize("noisy_runs", [3, 4, 6, 12])
def test_ordinary_spread_gives_no_alarm(noisy_runs):
    spread = np.exp(np.random.default_rng(0).normal(scale=1 / 3, size=(5000, 2, noisy_runs)))

    alarms = sum(int(find_collapsed(matrix).sum()) for matrix in spread)

    assert alarms == 0


@given(st.integers(0, 2**32 - 1), st.integers(3, 12))
def test_a_run_a_hundred_times_worse_is_found(seed, noisy_runs):
    rng = np.random.default_rng(seed)
    matrix = np.exp(0.2 * rng.normal(size=(2, noisy_runs)))
    broken = int(rng.integers(noisy_runs))
    matrix[:, broken] *= 100

    assert np.flatnonzero(find_collapsed(matrix)).tolist() == [broken]


def test_agreeing_with_one_clean_run_is_enough():
    matrix = np.array([[2.0, 2.1, 2.2, 2.5], [2.0, 2.3, 400.0, 2.4]])

    assert not find_collapsed(matrix).any()


def test_other_noisy_runs_tell_when_the_clean_run_collapsed():
    matrix = np.array([[400.0, 390.0, 410.0, 395.0]])
    noisy_noisy = np.array([[0, 2, 350, 3], [2, 0, 360, 2.5], [350, 360, 0, 355], [3, 2.5, 355, 0]])

    assert not find_collapsed(matrix).any()
    assert find_collapsed(matrix, noisy_noisy).tolist() == [False, False, True, False]


def test_failed_pairs_are_not_collapsed():
    matrix = np.hstack([DTU, [[np.nan]]])

    assert find_collapsed(matrix).tolist() == [True, False, False, False, False, False, False]


@pytest.mark.parametrize("shape", [(0, 0), (2, 0), (2, 1), (2, 2), (0, 4)])
def test_too_few_runs_give_no_alarm(shape):
    assert find_collapsed(np.arange(1.0, 1 + shape[0] * shape[1]).reshape(shape)).tolist() == [False] * shape[1]


@pytest.mark.parametrize("matrix", [np.zeros((2, 4)), np.array([[0.0, 0.0, 0.0, 1e-3]])])
def test_zeros_do_not_break_the_rule(matrix):
    assert find_collapsed(matrix).tolist() == (matrix[0] > 0).tolist()
