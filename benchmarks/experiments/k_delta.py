"""Show how agreement with the true error grows with the number of noisy runs (the paper's figure on k_delta)."""

from collections.abc import Sequence

import numpy as np

from benchmarks.experiments.settings import Outcome
from gtf_tune.gtf import Aggregate, aggregate_matrix

DRAWS = 200


def r_squared_by_count(outcome: Outcome, aggregate: Aggregate, counts: Sequence[int]) -> list[float]:
    """Return R2 between score and true error for each number of noisy runs, averaged over random choices of them.

    All settings are scored on the same choice, as in a study.
    """
    settings = outcome.feasible
    true = np.array([one.true_ate for one in settings])
    available = min(one.matrix.shape[1] for one in settings)
    generator = np.random.default_rng(0)
    found = []
    for count in counts:
        values = []
        for _ in range(DRAWS if count < available else 1):
            chosen = generator.permutation(available)[:count]
            scores = [aggregate_matrix(one.matrix[:, chosen], aggregate) for one in settings]
            values.append(np.corrcoef(scores, true)[0, 1] ** 2)
        found.append(float(np.mean(values)))
    return found
