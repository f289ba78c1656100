"""Judge picks by ground truth on noisy images that they have not seen."""

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from itertools import combinations
from types import MappingProxyType

import numpy as np

from experiments.estimators import paired_ratio
from experiments.findings import WORTH_FINDING
from experiments.k_delta import DRAWS
from experiments.numbers import Table, mean, percent, plain, share, spearman
from experiments.plan import AGGREGATE
from experiments.settings import AGGREGATES, Outcome, Setting
from gtf_tune.gtf import Aggregate, aggregate_matrix

Scorer = Callable[[Setting, Setting, Sequence[int]], float]
"""Score a setting, beside nominal, from the noisy runs of these indices and all clean ones."""


def _aggregated(aggregate: Aggregate, setting: Setting, _nominal: Setting, seen: Sequence[int]) -> float:
    return aggregate_matrix(setting.matrix[:, list(seen)], aggregate)


def _paired(setting: Setting, nominal: Setting, seen: Sequence[int]) -> float:
    return paired_ratio(nominal.matrix[:, list(seen)], setting.matrix[:, list(seen)])


SCORERS: Mapping[str, Scorer] = MappingProxyType(
    {**{name: partial(_aggregated, name) for name in AGGREGATES}, "paired": _paired}
)
"""The predictors that can be measured on some of the noisy runs of a stored experiment."""


@dataclass(frozen=True)
class Unseen:
    """Changes of the true error over unseen noisy images against nominal's, averaged over splits of the runs.

    ``by_score`` is that of the setting which the score picks from the seen half; ``by_clean_truth`` and
    ``by_seen_truth`` those of the settings which ground truth picks from clean runs and from the seen noisy ones;
    ``hindsight`` that of the best setting on the unseen half itself, which no choice can know. ``spearman`` is the
    rank correlation of the score with the true error over unseen images, ``clean_spearman`` that of the true error of
    clean runs with it.
    """

    by_score: float
    by_clean_truth: float
    by_seen_truth: float
    hindsight: float
    spearman: float
    clean_spearman: float


def on_unseen(outcome: Outcome, scorer: Scorer) -> Unseen | None:
    """Return what a pick from half of the noisy runs does on the other half; None where their truth is not known."""
    settings = outcome.feasible
    runs = min(len(setting.noisy_true_ates) for setting in settings)
    errors = np.array([setting.noisy_true_ates[:runs] for setting in settings], dtype=np.float64)
    if runs < 2 or np.isnan(errors).any():
        return None
    clean = [setting.true_ate for setting in settings]
    found = []
    for seen in _halves(runs):
        unseen = [index for index in range(runs) if index not in seen]
        before, after = (np.median(errors[:, half], axis=1) for half in (list(seen), unseen))
        changes = after / after[0] - 1
        scores = [scorer(setting, outcome.nominal, seen) for setting in settings]
        chosen = [int(np.argmin(values)) for values in (scores, clean, before, after)]
        found.append([*changes[chosen], spearman(scores, after.tolist()), spearman(clean, after.tolist())])
    return Unseen(*(mean(column) for column in zip(*found, strict=True)))


def share_on_unseen(outcomes: Sequence[Outcome], scorer: Scorer) -> tuple[float, int]:
    """Return the part of the gain possible in hindsight that picks reach on unseen images, and over how many grids."""
    found = shares([one for one in (on_unseen(outcome, scorer) for outcome in outcomes) if one is not None])
    return found.by_score, found.grids


@dataclass(frozen=True)
class Shares:
    """The parts of the gain possible in hindsight that three ways to choose reach, over some number of grids."""

    by_score: float
    by_clean_truth: float
    by_seen_truth: float
    grids: int


def shares(found: Sequence[Unseen]) -> Shares:
    """Return the average shares over grids where hindsight gains more than 3 %."""
    worth = [one for one in found if one.hindsight < -WORTH_FINDING]
    return Shares(
        mean(_share(one.by_score, one) for one in worth),
        mean(_share(one.by_clean_truth, one) for one in worth),
        mean(_share(one.by_seen_truth, one) for one in worth),
        len(worth),
    )


def picks_on_unseen(outcomes: Sequence[Outcome]) -> list[tuple[Outcome, Unseen]]:
    """Return what the picks of the default aggregate do on unseen images, for the grids where their truth is known."""
    found = [(outcome, on_unseen(outcome, SCORERS[AGGREGATE])) for outcome in outcomes]
    return [(outcome, one) for outcome, one in found if one is not None]


def unseen_table(outcomes: Sequence[Outcome]) -> Table:
    """Return what picks do on unseen images, beside what ground truth picks from the same runs."""
    known = picks_on_unseen(outcomes)
    rows = [
        [
            f"{outcome.experiment.sequence} {outcome.experiment.option.short}",
            *(percent(value) for value in (one.by_score, one.by_clean_truth, one.by_seen_truth, one.hindsight)),
            plain(one.spearman),
            plain(one.clean_spearman),
        ]
        for outcome, one in known
    ]
    if rows:
        rows.insert(0, _average([one for _, one in known]))
    columns = ["experiment", "picked by GTF", "by truth of clean runs", "by truth of seen noisy runs", "in hindsight"]
    return [*columns, "score and unseen truth", "clean and unseen truth"], rows


def _average(found: Sequence[Unseen]) -> list[str]:
    reached = shares(found)
    cells = [share(one) for one in (reached.by_score, reached.by_clean_truth, reached.by_seen_truth)]
    correlations = [plain(mean(one.spearman for one in found)), plain(mean(one.clean_spearman for one in found))]
    return [f"share of hindsight, {reached.grids} grids", *cells, "100%", *correlations]


def _share(change: float, one: Unseen) -> float:
    return max(change / one.hindsight, -1.0)


def _halves(count: int) -> list[tuple[int, ...]]:
    """Return all choices of half of the runs, or a random selection where they are many."""
    if math.comb(count, count // 2) <= DRAWS:
        return list(combinations(range(count), count // 2))
    generator = np.random.default_rng(0)
    return [tuple(generator.permutation(count)[: count // 2].tolist()) for _ in range(DRAWS)]
