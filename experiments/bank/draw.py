"""What a rule may see of one sequence: some of its runs, each of which it pays for, and what other sequences say."""

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property, lru_cache

import numpy as np

from experiments.bank.bank import COPIES, STAGES, Bank
from experiments.bank.plan import CONFIGURATIONS, SIGMAS
from gtf_tune.gtf import Aggregate
from gtf_tune.gtf.aggregate import aggregate_last_axis
from gtf_tune.trajectory import FloatArray, IntArray

RunCounts = tuple[int, int]
"""Clean and noisy runs: k and k_delta."""

FAILED = 1.0
"""The error of a run that failed or cannot be compared: the largest that a relative ATE after Sim(3) can have."""

_FAR = 5.0
_ENOUGH = ((2, 4), (1, 2))
_FRONT = len(("images", "features", "matches"))
_FEWEST_TRAINED = 2


class TooFewRunsError(Exception):
    """Signal that the bank has too few runs of a sequence for what a rule asks."""


@dataclass(frozen=True)
class Block:
    """Runs of one sequence that exist under all of the first ``configurations``: places of clean and noisy copies."""

    configurations: int
    clean: IntArray
    noisy: dict[float, IntArray]


@lru_cache(maxsize=256)
def block(bank: Bank, sequence: int) -> Block | None:
    """Return the block of most configurations that has two clean and four noisy runs, or at least one and two."""
    for least in _ENOUGH:
        for count in sorted({5, 8, 10, len(bank.labels)}, reverse=True):
            whole = np.flatnonzero(bank.present[sequence, :count].all(axis=0))
            levels = {sigma: np.intersect1d(bank.columns(sigma), whole) for sigma in (0.0, *SIGMAS)}
            if count <= len(bank.labels) and len(levels[0.0]) >= least[0] and len(levels[SIGMAS[0]]) >= least[1]:
                return Block(count, levels.pop(0.0), levels)
    return None


def seen_of(noisy: int) -> int:
    """Return how many of so many noisy copies a rule may see: half, or all but one of few."""
    return max(noisy // 2, min(3, noisy - 1))


@dataclass(frozen=True, eq=False)
class Draw:
    """One split of the runs of a sequence into those that a rule may see and those that judge it.

    ``clean`` and ``noisy`` are places of copies in the order in which the rule gets them; ``unseen`` are the noisy
    copies of the weaker level whose true errors judge. ``others`` are the sequences that may teach constants.
    """

    bank: Bank
    sequence: int
    configurations: int
    clean: IntArray
    noisy: dict[float, IntArray]
    unseen: IntArray
    others: "Others"
    used: set[tuple[int, int]] = field(default_factory=set)

    def tables(self, members: Sequence[int], runs: RunCounts, sigma: float = SIGMAS[0]) -> FloatArray:
        """Return errors of noisy against clean runs, (members, k, k_delta), and charge the runs.

        Raises
        ------
        TooFewRunsError
            There are not so many runs.
        """
        clean, noisy = self._first(self.clean, runs[0]), self._first(self.noisy[sigma], runs[1])
        self._charge(members, [*clean, *noisy])
        return run_errors(self.bank, self.sequence, members, clean, noisy)

    def clean_pairs(self, members: Sequence[int], k: int) -> FloatArray:
        """Return errors of clean runs against each other, (members, pairs), and charge the runs."""
        return self._pairs(members, self._first(self.clean, k))

    def noisy_pairs(self, members: Sequence[int], k_delta: int) -> FloatArray:
        """Return errors of noisy runs of the weaker level against each other, (members, pairs), and charge the runs."""
        return self._pairs(members, self._first(self.noisy[SIGMAS[0]], k_delta))

    def true_errors(self, members: Sequence[int], runs: RunCounts) -> FloatArray:
        """Return true errors of seen runs, (members, k + k_delta): what tuning with ground truth would see."""
        places = [*self._first(self.clean, runs[0]), *self._first(self.noisy[SIGMAS[0]], runs[1])]
        self._charge(members, places)
        return _filled(self.bank.per_run["true"][self.sequence][np.ix_(members, places)])

    def reversed(self) -> "Draw":
        """Return the same runs with the noisy copies the other way round; both pay into one purse."""
        return replace(self, noisy={sigma: places[::-1] for sigma, places in self.noisy.items()})

    def unseen_truth(self) -> FloatArray:
        """Return the median true error of every configuration over the copies that no rule sees."""
        errors = self.bank.per_run["true"][self.sequence][: self.configurations, self.unseen]
        return np.asarray(np.median(_filled(errors), axis=1))

    @property
    def price(self) -> float:
        """Return the processor time of the runs that were asked for, in plain runs: cold ones with nominal options."""
        return price(self.bank, self.sequence, self.used)

    @cached_property
    def everything(self) -> list[int]:
        return list(range(self.configurations))

    def _first(self, places: IntArray, count: int) -> list[int]:
        if len(places) < count:
            raise TooFewRunsError
        return [int(place) for place in places[:count]]

    def _pairs(self, members: Sequence[int], places: list[int]) -> FloatArray:
        self._charge(members, places)
        pairs = [(min(a, b), max(a, b)) for at, a in enumerate(places) for b in places[at + 1 :]]
        errors = [self.bank.pairs[self.sequence, list(members), a, b] for a, b in pairs]
        return _filled(np.array(errors).T)

    def _charge(self, members: Sequence[int], places: Sequence[int]) -> None:
        self.used.update((member, place) for member in members for place in places)


def price(bank: Bank, sequence: int, used: set[tuple[int, int]]) -> float:
    """Return what runs, as (configuration, place), cost in plain runs, where stages are shared as the cache does it."""
    plain = bank.seconds[sequence, 0].sum()
    front = bank.seconds[sequence, 0, :_FRONT].sum()
    images = {COPIES[place] if COPIES[place].sigma else "clean" for _, place in used}
    verified = {(_verification(bank.labels[member]), place): member for member, place in sorted(used, reverse=True)}
    middle = sum(_middle(bank, sequence, member) for member in verified.values())
    mapping = sum(bank.seconds[sequence, member, -1] for member, _ in used)
    return float((len(images) * front + middle + mapping) / plain)


@lru_cache(maxsize=1024)
def _middle(bank: Bank, sequence: int, member: int) -> float:
    """Return the seconds of verification and positioning, which configurations of equal verification share."""
    alike = [
        other
        for other, label in enumerate(bank.labels)
        if _verification(label) == _verification(bank.labels[member])
        and not np.isnan(bank.seconds[sequence, other, _FRONT : len(STAGES) - 1]).any()
    ]
    return float(bank.seconds[sequence, alike[0] if alike else 0, _FRONT : len(STAGES) - 1].sum())


@lru_cache(maxsize=256)
def _verification(label: str) -> frozenset[tuple[str, object]]:
    return frozenset(item for item in CONFIGURATIONS[label].items() if item[0].startswith("verification."))


class Others:
    """What the sequences of other groups say: constants of rules are chosen on them alone."""

    def __init__(self, bank: Bank, group: str) -> None:
        self.bank = bank
        self.sequences = [
            place for place, other in enumerate(bank.groups) if other != group and block(bank, place) is not None
        ]

    @cached_property
    def truth(self) -> FloatArray:
        """Return logarithms of the true error over nominal's, (sequences, configurations); NaN where there is none."""
        rows = []
        for sequence in self.sequences:
            found = self._block(sequence)
            errors = _filled(self.bank.per_run["true"][sequence][:, found.noisy[SIGMAS[0]]])
            medians = np.log(np.median(errors, axis=1))
            rows.append(self._known(medians - medians[0], found))
        return np.array(rows)

    @lru_cache(maxsize=32)  # noqa: B019 - as many as there are groups, all as long-lived as the replay
    def scores(self, runs: RunCounts) -> FloatArray:
        """Return logarithms of the score over nominal's by as few runs as a rule takes, NaN where there are too few."""
        rows = []
        for sequence in self.sequences:
            found = self._block(sequence)
            clean, noisy = found.clean[: runs[0]].tolist(), found.noisy[SIGMAS[0]][: runs[1]].tolist()
            members = range(found.configurations)
            ratios = paired_ratios(run_errors(self.bank, sequence, members, clean, noisy))
            padded = np.full(len(self.bank.labels), np.nan)
            padded[: found.configurations] = ratios
            rows.append(padded)
        return np.array(rows)

    @cached_property
    def mean_truth(self) -> FloatArray:
        """Return the mean over sequences of `truth`, (configurations,); NaN of those that few sequences have."""
        trained = (~np.isnan(self.truth)).sum(axis=0)
        sums = np.nansum(self.truth, axis=0)
        return np.where(trained >= _FEWEST_TRAINED, sums / np.maximum(trained, 1), np.nan)

    @lru_cache(maxsize=32)  # noqa: B019
    def portfolio(self, size: int, configurations: int) -> tuple[int, ...]:
        """Return nominal and the configurations that, one after the other, lower the best true error most.

        Those are chosen among as many of the configurations as a few sequences have all of.
        """
        rows, chosen = self._whole(configurations), [0]
        while len(chosen) < min(size, rows.shape[1]):
            best = rows[:, chosen].min(axis=1)
            gains = np.minimum(rows, best[:, np.newaxis]).mean(axis=0)
            gains[chosen] = np.inf
            chosen.append(int(np.argmin(gains)))
        return tuple(chosen)

    def _whole(self, configurations: int) -> FloatArray:
        for count in range(configurations, 1, -1):
            rows = self.truth[:, :count] if len(self.sequences) else np.empty((0, count))
            rows = rows[~np.isnan(rows).any(axis=1)]
            if len(rows) >= _FEWEST_TRAINED:
                return rows
        return np.empty((0, 1))

    def _block(self, sequence: int) -> Block:
        found = block(self.bank, sequence)
        if found is None:
            raise TooFewRunsError
        return found

    def _known(self, values: FloatArray, found: Block) -> FloatArray:
        return np.where(np.arange(len(values)) < found.configurations, values, np.nan)


def paired_ratios(tables: FloatArray) -> FloatArray:
    """Return the mean logarithm of the error of each configuration over the first one's, (members,).

    Pairs that diverged under every configuration alike are set aside: they say nothing about the choice.
    """
    logs = np.log(set_aside(tables))
    return np.asarray(np.nanmean(logs - logs[:1], axis=(1, 2)))


def set_aside(tables: FloatArray) -> FloatArray:
    """Return tables, (members, k, k_delta), with NaN in pairs that lie far above the median in every table."""
    medians = np.median(tables, axis=(1, 2), keepdims=True)
    diverged = np.asarray((tables > _FAR * medians).all(axis=0))
    return np.where(diverged, np.nan, tables)


def aggregated(tables: FloatArray, aggregate: Aggregate) -> FloatArray:
    """Return the score of each table by an aggregate over all of its pairs, (members,)."""
    return aggregate_last_axis(tables.reshape(len(tables), -1), aggregate)


def run_errors(
    bank: Bank, sequence: int, members: Sequence[int], clean: Sequence[int], noisy: Sequence[int]
) -> FloatArray:
    """Return errors of noisy against clean runs, (members, k, k_delta); 1 where a run failed."""
    return _filled(bank.pairs[sequence][np.ix_(list(members), list(clean), list(noisy))])


def _filled(errors: FloatArray) -> FloatArray:
    return np.maximum(np.where(np.isnan(errors), FAILED, errors), np.finfo(np.float64).tiny)
