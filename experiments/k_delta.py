"""Show how agreement with the true error grows with the number of noisy runs (the paper's figure on k_delta)."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from experiments.settings import AGGREGATES, Outcome
from gtf_tune.gtf import Aggregate, aggregate_matrix

DRAWS = 200


def r_squared_by_count(outcome: Outcome, aggregate: Aggregate, counts: Sequence[int]) -> list[float]:
    """Return R2 between score and true error for each number of noisy runs, averaged over random choices of them.

    All settings are scored on the same choice, as in a study.
    """
    settings = outcome.feasible
    true = np.array([setting.true_ate for setting in settings])
    available = min(setting.matrix.shape[1] for setting in settings)
    generator = np.random.default_rng(0)
    found = []
    for count in counts:
        values = []
        for _ in range(DRAWS if count < available else 1):
            chosen = generator.permutation(available)[:count]
            scores = [aggregate_matrix(setting.matrix[:, chosen], aggregate) for setting in settings]
            values.append(np.corrcoef(scores, true)[0, 1] ** 2)
        found.append(float(np.mean(values)))
    return found


@dataclass(frozen=True)
class Curve:
    """R2 between score and true error for each number of noisy runs, by aggregate."""

    study: str
    counts: tuple[int, ...]
    r_squared: Mapping[str, Sequence[float]]


def curve(outcome: Outcome) -> Curve:
    """Return the curve of a grid with many noisy runs."""
    counts = tuple(range(1, outcome.nominal.matrix.shape[1] + 1))
    found: dict[str, list[float]] = {name: r_squared_by_count(outcome, name, counts) for name in AGGREGATES}
    return Curve(outcome.experiment.study, counts, found)


@dataclass(frozen=True)
class Picks:
    """Say what picks from random choices of noisy runs are worth: changes of the true ATE, negative where better."""

    mean: float
    worst_decile: float
    regressions: float


def picks(outcome: Outcome, aggregate: Aggregate, count: int) -> Picks:
    """Return what an aggregate's pick is worth over random choices of ``count`` noisy runs.

    A regression is a pick worse than nominal by more than 1 %.
    """
    settings = outcome.feasible
    available = min(setting.matrix.shape[1] for setting in settings)
    generator = np.random.default_rng(0)
    changes = []
    for _ in range(DRAWS):
        chosen = generator.permutation(available)[:count]
        scores = [aggregate_matrix(setting.matrix[:, chosen], aggregate) for setting in settings]
        changes.append(outcome.change(settings[int(np.argmin(scores))]))
    found = np.array(changes)
    return Picks(float(found.mean()), float(np.quantile(found, 0.9)), float((found > 0.01).mean()))
