"""Replay rules on the bank: what they adopt from runs that they see, judged by ground truth on runs unseen."""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from experiments.bank.bank import Bank
from experiments.bank.draw import Block, Draw, Others, TooFewRunsError, block, seen_of
from experiments.bank.plan import SIGMAS
from experiments.bank.rules import Rule
from gtf_tune.trajectory import FloatArray

DRAWS = 40
RESAMPLES = 4000
BROKEN = 0.1
"""True error of nominal, over the extent, above which a sequence is broken: nothing there is worth a comparison."""

CLEARLY = 0.02


@dataclass(frozen=True, eq=False)
class Replayed:
    """What one rule does on each sequence by its place in the bank: true change of what it adopts, and price.

    ``changes`` are those of the expected true error over nominal's, as shares; prices are in plain runs; ``picks`` say
    how often each configuration was adopted.
    """

    rule: str
    changes: Mapping[int, float]
    prices: Mapping[int, float]
    picks: Mapping[int, Mapping[int, int]]

    def values(self, sequences: Sequence[int]) -> FloatArray:
        return np.array([self.changes[place] for place in sequences if place in self.changes])

    def worse(self, sequences: Sequence[int]) -> int:
        return int((self.values(sequences) > CLEARLY).sum())

    def better(self, sequences: Sequence[int]) -> int:
        return int((self.values(sequences) < -CLEARLY).sum())


def replay(bank: Bank, rules: Mapping[str, Rule], count: int = DRAWS) -> list[Replayed]:
    """Return what every rule does on each sequence that has enough runs; the draws are the same for all rules."""
    others = {group: Others(bank, group) for group in set(bank.groups)}
    made = {
        place: list(draws(bank, place, found, others[bank.groups[place]], count))
        for place in range(len(bank.sequences))
        if (found := block(bank, place)) is not None
    }
    return [_replayed(name, rule, made) for name, rule in rules.items()]


def draws(bank: Bank, sequence: int, found: Block, others: Others, count: int = DRAWS) -> Iterator[Draw]:
    """Yield random splits of the runs of a sequence into seen and unseen ones, in random order."""
    generator = np.random.default_rng(sequence)
    weak, strong = SIGMAS
    for _ in range(count):
        order = generator.permutation(found.noisy[weak])
        seen = seen_of(len(order))
        hidden = set((order[seen:] - bank.columns(weak)[0]).tolist())  # their pattern is that of the louder copies
        louder = [place for place in found.noisy[strong] if place - bank.columns(strong)[0] not in hidden]
        noisy = {weak: order[:seen], strong: generator.permutation(np.array(louder, dtype=np.int64))}
        clean = generator.permutation(found.clean)
        yield Draw(bank, sequence, found.configurations, clean, noisy, order[seen:], others)


def _replayed(name: str, rule: Rule, made: Mapping[int, Sequence[Draw]]) -> Replayed:
    changes, prices, picks = {}, {}, {}
    for place, some in made.items():
        try:
            adopted = [_adopted(rule, draw) for draw in some]
        except TooFewRunsError:
            continue
        truth = np.array([draw.unseen_truth() for draw in some])
        chosen = truth[np.arange(len(some)), [pick for pick, _ in adopted]]
        changes[place] = float(chosen.mean() / truth[:, 0].mean() - 1)
        prices[place] = float(np.mean([paid for _, paid in adopted]))
        counted = np.unique([pick for pick, _ in adopted], return_counts=True)
        picks[place] = dict(zip(*(part.tolist() for part in counted), strict=True))
    return Replayed(name, changes, prices, picks)


def _adopted(rule: Rule, draw: Draw) -> tuple[int, float]:
    draw.used.clear()
    return rule(draw), draw.price


def sound(bank: Bank) -> list[int]:
    """Return the sequences that have enough runs and whose nominal reconstruction is sound."""
    return [place for place in range(len(bank.sequences)) if 0 <= nominal_truth(bank, place) <= BROKEN]


def nominal_truth(bank: Bank, place: int) -> float:
    """Return the median true error of nominal over the extent; -1 where there are too few runs."""
    found = block(bank, place)
    if found is None:
        return -1.0
    errors = bank.per_run["true"][place, 0, found.noisy[SIGMAS[0]]]
    return float(np.median(np.where(np.isnan(errors), 1.0, errors)))


def interval(bank: Bank, found: Replayed, sequences: Sequence[int]) -> tuple[float, float]:
    """Return the 90 % interval of the mean change by a bootstrap over groups of sequences."""
    groups = sorted({bank.groups[place] for place in sequences if place in found.changes})
    by_group = [found.values([place for place in sequences if bank.groups[place] == group]) for group in groups]
    if not by_group:
        return np.nan, np.nan
    sums, sizes = (np.array([fold(values) for values in by_group]) for fold in (np.sum, len))
    chosen = np.random.default_rng(0).integers(0, len(groups), (RESAMPLES, len(groups)))
    means = sums[chosen].sum(axis=1) / sizes[chosen].sum(axis=1)
    low, high = np.quantile(means, (0.05, 0.95))
    return float(low), float(high)
