import numpy as np
import pytest
from scipy.stats import norm

from gtf_tune.study.outcome.confirm import looks_at


@pytest.mark.parametrize(
    ("noisy_runs", "counts"),
    [(4, [4]), (7, [7]), (8, [4, 8]), (13, [5, 9, 13]), (16, [4, 8, 12, 16]), (40, [10, 20, 30, 40])],
)
def test_looks_are_spread_evenly(noisy_runs: int, counts: list[int]) -> None:
    assert [look.noisy_runs for look in looks_at(noisy_runs)] == counts


@pytest.mark.parametrize("noisy_runs", [4, 8, 12, 16])
def test_over_all_looks_equal_configurations_are_told_apart_in_5_percent(noisy_runs: int) -> None:
    looks = looks_at(noisy_runs)
    sums = np.random.default_rng(0).normal(size=(200_000, noisy_runs)).cumsum(axis=1)

    found = np.zeros(len(sums), dtype=bool)
    for look in looks:
        z = sums[:, look.noisy_runs - 1] / np.sqrt(look.noisy_runs)
        found |= 2 * norm.sf(np.abs(z)) < look.significance

    assert found.mean() == pytest.approx(0.05, abs=0.002)


def test_later_looks_need_less() -> None:
    levels = [look.significance for look in looks_at(16)]

    assert levels == sorted(levels)
    assert levels[-1] < 0.05
