"""Decide how many noisy runs a trial gets.

A trial that is stopped early keeps its score so far, but it has not been compared on all instances, so it cannot be
picked: it ends *pruned*, in Optuna's sense of the word. Complete trials have all instances, so the smallest value of
any complete trial is the best one everywhere, and a lucky start does not help.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Protocol

import numpy as np
from scipy.special import stdtr

from gtf_tune.definition import StudyDefinition
from gtf_tune.gtf.aggregate import Aggregate, aggregate_last_axis
from gtf_tune.gtf.random_effects import COLLAPSE_FACTOR

SIGNIFICANCE = 0.1
"""How improbable a trial's arrears must be before it is stopped; measured in benchmarks/sizing_rules.py."""

PRUNER_FIRST = 6
"""Noisy runs before Optuna's pruner is asked: no fewer can reach p = 0.02, since the smallest p-value is 2^-n."""

PRUNER_STEP = 2

USUAL_SPREAD = 0.15
"""Standard deviation of paired log ratios before any are seen.

Measured on dtu-scan24 with GLOMAP (16 instances, sigma 2): 0.06 to 0.18 between settings that differ, while the log
scores of one setting spread by 0.5. The analytic pipeline has 0.14.
"""

USUAL_FREEDOM = 3.0
"""Weight of `USUAL_SPREAD`, as degrees of freedom: three ratios that agree by luck are not taken for certainty."""

_FEWEST = 2


@dataclass(frozen=True)
class Decision:
    """How many noisy runs a trial should have in all; ``hopeless`` where it ends with fewer than others get."""

    noisy_runs: int
    reason: str = ""
    hopeless: bool = False


class Sizing(Protocol):
    """Decide the number of noisy runs of trials from instance values alone, so that a resumed study repeats it.

    The incumbent always has the most instances that the sizing gives: only a complete trial can become the incumbent.
    """

    def first(self, *, is_nominal: bool) -> int:
        """Return how many noisy runs a trial starts with; nominal, the first incumbent, gets all at once."""
        ...

    def next(self, own: Sequence[float], incumbent: Sequence[float]) -> Decision:
        """Return how many noisy runs the trial should have; as many as it has means stop.

        Parameters
        ----------
        own, incumbent
            Scores of the noise instances of the trial and of the best trial before it, positive and paired by position
            because all trials share the noise. ``own`` is empty for an infeasible trial, ``incumbent`` while there is
            no other trial to compare with.
        """
        ...


@dataclass(frozen=True)
class FixedSizing:
    """Give every trial the same number of noisy runs: the paper's k_delta."""

    noisy_runs: int

    def first(self, *, is_nominal: bool) -> int:
        """Return k_delta."""
        del is_nominal
        return self.noisy_runs

    def next(self, own: Sequence[float], incumbent: Sequence[float]) -> Decision:
        """Stop."""
        del incumbent
        return Decision(len(own))


@dataclass(frozen=True)
class AdaptiveSizing:
    """Add noisy runs by ``least`` at a time, as long as the trial may still be better than the incumbent.

    A trial that is significantly worse stops. One that is significantly better, or has nothing to compare with, goes
    to ``most`` at once: the next incumbent must be measured in full. So does one that stays undecided.
    """

    least: int
    most: int
    aggregate: Aggregate = "mean"
    significance: float = SIGNIFICANCE

    def first(self, *, is_nominal: bool) -> int:
        """Return ``least``, and ``most`` for nominal."""
        return self.most if is_nominal else self.least

    def next(self, own: Sequence[float], incumbent: Sequence[float]) -> Decision:
        """Compare on the instances that both have."""
        count = len(own)
        if not count or count >= self.most:
            return Decision(count)
        if not incumbent:
            return Decision(self.most, "no other feasible trial to compare with")
        if self._cannot_win(own, incumbent):
            return Decision(count, f"cannot beat the best trial any more after {count} noisy runs", hopeless=True)
        found = compare(own, incumbent, collapses_count=self.aggregate == "mean")
        if found.p_worse < self.significance:
            reason = f"{found.percent:.3g} % worse than the best trial on {count} noisy runs (p = {found.p_worse:.2g})"
            return Decision(count, reason, hopeless=True)
        if found.p_better < self.significance:
            reason = f"{-found.percent:.3g} % better than the best trial on {count} noisy runs: measured in full"
            return Decision(self.most, reason)
        return Decision(min(count + self.least, self.most), "competes with the best trial")

    def _cannot_win(self, own: Sequence[float], incumbent: Sequence[float]) -> bool:
        """Return True if the trial stays above the incumbent even if every further instance scores 0."""
        perfect = np.zeros(self.most)
        perfect[: len(own)] = own
        to_beat = aggregate_last_axis(np.asarray(incumbent, dtype=np.float64), self.aggregate)
        return bool(aggregate_last_axis(perfect, self.aggregate) > to_beat)


@dataclass(frozen=True)
class PrunerSizing:
    """Add noisy runs two at a time up to ``most``, so that Optuna's pruner can be asked in between."""

    most: int

    def first(self, *, is_nominal: bool) -> int:
        """Return as many as the pruner needs, and ``most`` for nominal."""
        return self.most if is_nominal else min(PRUNER_FIRST, self.most)

    def next(self, own: Sequence[float], incumbent: Sequence[float]) -> Decision:
        """Go on until all are there."""
        del incumbent
        count = len(own)
        return Decision(min(count + PRUNER_STEP, self.most) if count else 0)


def sizing_of(definition: StudyDefinition) -> Sizing:
    """Return the sizing that a definition asks for."""
    gtf = definition.gtf
    if definition.search.pruner == "wilcoxon":
        return PrunerSizing(gtf.noisy_runs_max)
    if gtf.noisy_runs_min < gtf.noisy_runs_max:
        return AdaptiveSizing(gtf.noisy_runs_min, gtf.noisy_runs_max, gtf.aggregate)
    return FixedSizing(gtf.noisy_runs_max)


@dataclass(frozen=True)
class Comparison:
    """Comparison of a trial with the incumbent on their common noise instances.

    ``log_ratio`` is the mean of log(own / incumbent), below 0 where the trial is better. ``p_worse`` is the one-sided
    probability of a mean this high or higher if the two were equal: small where the trial is surely worse. ``p_better``
    is that of a mean this low or lower.
    """

    instances: int
    log_ratio: float
    p_worse: float
    p_better: float

    @property
    def percent(self) -> float:
        """Return by how many percent the trial's score is higher than the incumbent's."""
        return 100.0 * math.expm1(self.log_ratio)


def compare(own: Sequence[float], incumbent: Sequence[float], *, collapses_count: bool = False) -> Comparison:
    """Compare two lists of instance values, paired by position; what one has more than the other is left out.

    A t-test on log ratios, with two changes that make it usable from the second instance on. The variance is shrunk
    towards that of usual trials (the moderated t-test of Smyth, Stat. Appl. Genet. Mol. Biol. 3, 2004), and a ratio
    further than `COLLAPSE_FACTOR` from the median is left out, so that one collapsed run cannot decide. Where
    ``collapses_count``, as for a mean, which one collapsed run does decide, it counts as that factor instead.
    """
    common = min(len(own), len(incumbent))
    ratios = _log_ratios(own[:common], incumbent[:common])
    if len(ratios) < _FEWEST:
        return Comparison(len(ratios), float(ratios.mean()) if len(ratios) else 0.0, 1.0, 1.0)
    limit = math.log(COLLAPSE_FACTOR)
    median = float(np.median(ratios))
    kept = np.clip(ratios, median - limit, median + limit)
    near = np.abs(ratios - median) <= limit
    if not collapses_count and near.sum() > common / 2:  # else nobody can say which ones are odd
        kept = ratios[near]
    freedom = USUAL_FREEDOM + len(kept) - 1
    variance = (USUAL_FREEDOM * USUAL_SPREAD**2 + float(((kept - kept.mean()) ** 2).sum())) / freedom
    t = float(kept.mean()) / math.sqrt(variance / len(kept))
    return Comparison(common, float(kept.mean()), float(stdtr(freedom, -t)), float(stdtr(freedom, t)))


def _log_ratios(own: Sequence[float], incumbent: Sequence[float]) -> np.ndarray[tuple[int], np.dtype[np.float64]]:
    smallest = np.finfo(np.float64).tiny
    first, second = (np.log(np.maximum(np.asarray(values, dtype=np.float64), smallest)) for values in (own, incumbent))
    return np.asarray(first - second, dtype=np.float64)
