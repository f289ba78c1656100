import math
from typing import Any

import numpy as np
import pytest

from gtf_tune.study.outcome.improvement import Improvement, paired_improvement, stored_matrices

COMMON = np.exp(0.3 * np.random.default_rng(5).standard_normal(6))


def detail(size: float, *, seed: int = 0, spread: float = 0.02, **collapsed: float) -> dict[str, Any]:
    """Return what is stored of a trial whose noisy run ``at`` is ``times`` worse than it should be."""
    matrix = size * COMMON * np.exp(spread * np.random.default_rng(seed).standard_normal((2, 6)))
    if collapsed:
        matrix[:, int(collapsed["at"])] *= collapsed["times"]
    return {"sequences": {"room": {"matrix": matrix.tolist()}}}


def improvement(nominal: dict[str, Any], other: dict[str, Any]) -> Improvement:
    return paired_improvement(stored_matrices(nominal), stored_matrices(other))


def test_a_collapsed_run_of_the_best_trial_hides_no_improvement() -> None:
    found = improvement(detail(1.0), detail(0.7, seed=1, at=2, times=100.0))

    assert found.value == pytest.approx(0.3, abs=0.03)
    assert 0.2 < found.low < found.high < 0.4
    assert found.instances == 5


def test_a_collapsed_run_of_nominal_is_no_improvement() -> None:
    found = improvement(detail(1.0, at=2, times=100.0), detail(0.99, seed=1))

    assert found.low < 0 < found.high < 0.1


def test_clean_runs_that_differ_widen_the_interval() -> None:
    apart = detail(0.9, seed=1)
    apart["sequences"]["room"]["matrix"][1] = [1.4 * one for one in apart["sequences"]["room"]["matrix"][1]]

    together, wide = improvement(detail(1.0), detail(0.9, seed=1)), improvement(detail(1.0), apart)

    assert wide.high - wide.low > 5 * (together.high - together.low)


def test_several_sequences_count_by_their_geometric_mean() -> None:
    both = [
        {"sequences": {**detail(a)["sequences"], "hall": detail(b)["sequences"]["room"]}} for a, b in ((1, 7), (0.5, 7))
    ]

    assert improvement(*both).value == pytest.approx(1 - math.sqrt(0.5), abs=1e-6)


def test_one_noisy_run_has_an_improvement_without_an_interval() -> None:
    one = [{"sequences": {"room": {"matrix": [[size], [size]]}}} for size in (1.0, 0.8)]

    found = improvement(*one)

    assert found.value == pytest.approx(0.2)
    assert math.isnan(found.low)
    assert found.instances == 1


@pytest.mark.parametrize("stored", [{}, {"sequences": {"room": {"matrix": []}}}, {"sequences": {"room": {}}}])
def test_a_trial_without_a_matrix_is_not_compared(stored: dict[str, Any]) -> None:
    assert improvement(detail(1.0), stored).instances == 0


def test_a_failed_pair_leaves_its_instance_out() -> None:
    other = detail(0.7, seed=1)
    other["sequences"]["room"]["matrix"][0][4] = None

    assert improvement(detail(1.0), other).instances == 5
