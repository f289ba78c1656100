"""Decide how many noisy runs a trial gets.

A trial that is stopped early keeps its honest score so far, but it has not been compared on all instances, so it can
not be picked: it ends *pruned*, in Optuna's sense of the word. Complete trials have all instances. That is what makes
the smallest value of any complete trial the best one everywhere, and what a lucky start cannot get round.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Protocol

import numpy as np

from gtf_tune.definition import StudyDefinition
from gtf_tune.gtf.aggregate import Aggregate, aggregate_last_axis
from gtf_tune.study.scoring.racing import compare

SIGNIFICANCE = 0.1
"""How improbable a trial's arrears must be before it is stopped; measured in benchmarks/sizing_rules.py."""

PRUNER_FIRST = 6
"""Noisy runs before Optuna's pruner is asked: no fewer can reach p = 0.02, since the smallest p-value is 2^-n."""

PRUNER_STEP = 2


@dataclass(frozen=True)
class Standing:
    """Hold how a trial stands so far: its instance values in order, and those of the best trial before it.

    Values are positive scores of noisy instances, paired by position because all trials share the noise. ``own`` is
    empty for an infeasible trial, ``incumbent`` while there is no other trial to compare with.
    """

    own: Sequence[float]
    incumbent: Sequence[float]


@dataclass(frozen=True)
class Decision:
    """Say how many noisy runs the trial should have in all; ``hopeless`` where it ends with fewer than others get."""

    noisy_runs: int
    reason: str = ""
    hopeless: bool = False


class Sizing(Protocol):
    """Decide the number of noisy runs of trials, from nothing but instance values, so that a resumed study repeats it.

    The incumbent always has the most instances that the sizing gives: only trials that went all the way become one.
    """

    def first(self, *, is_nominal: bool) -> int:
        """Return how many noisy runs a trial starts with; nominal, the first incumbent, gets all at once."""
        ...

    def next(self, standing: Standing) -> Decision:
        """Return how many noisy runs the trial should have; as many as it has means stop."""
        ...


@dataclass(frozen=True)
class FixedSizing:
    """Give every trial the same number of noisy runs: the paper's k_delta."""

    noisy_runs: int

    def first(self, *, is_nominal: bool) -> int:
        """Return k_delta."""
        del is_nominal
        return self.noisy_runs

    def next(self, standing: Standing) -> Decision:
        """Stop."""
        return Decision(len(standing.own))


@dataclass(frozen=True)
class AdaptiveSizing:
    """Add noisy runs by ``least`` at a time, as long as the trial may still be better than the incumbent.

    A trial that is significantly worse stops. One that is significantly better, or has nobody to compare with, goes to
    ``most`` at once: the next incumbent must be measured in full. So does what stays undecided.
    """

    least: int
    most: int
    aggregate: Aggregate = "mean"
    significance: float = SIGNIFICANCE

    def first(self, *, is_nominal: bool) -> int:
        """Return ``least``, and ``most`` for nominal."""
        return self.most if is_nominal else self.least

    def next(self, standing: Standing) -> Decision:
        """Compare on the instances that both have."""
        count = len(standing.own)
        if not count or count >= self.most:
            return Decision(count)
        if not standing.incumbent:
            return Decision(self.most, "no other feasible trial to compare with")
        if self._cannot_win(standing):
            return Decision(count, f"cannot beat the best trial any more after {count} noisy runs", hopeless=True)
        found = compare(standing.own, standing.incumbent, collapses_count=self.aggregate == "mean")
        if found.p_worse < self.significance:
            reason = f"{found.percent:.3g} % worse than the best trial on {count} noisy runs (p = {found.p_worse:.2g})"
            return Decision(count, reason, hopeless=True)
        if found.p_better < self.significance:
            reason = f"{-found.percent:.3g} % better than the best trial on {count} noisy runs: measured in full"
            return Decision(self.most, reason)
        return Decision(min(count + self.least, self.most), "competes with the best trial")

    def _cannot_win(self, standing: Standing) -> bool:
        """Tell whether the trial stays above the incumbent even if every further instance scored 0."""
        perfect = np.zeros(self.most)
        perfect[: len(standing.own)] = standing.own
        incumbent = np.asarray(standing.incumbent, dtype=np.float64)
        return bool(aggregate_last_axis(perfect, self.aggregate) > aggregate_last_axis(incumbent, self.aggregate))


@dataclass(frozen=True)
class PrunerSizing:
    """Add noisy runs two at a time up to ``most``, so that Optuna's pruner can be asked in between."""

    most: int

    def first(self, *, is_nominal: bool) -> int:
        """Return as many as the pruner needs, and ``most`` for nominal."""
        return self.most if is_nominal else min(PRUNER_FIRST, self.most)

    def next(self, standing: Standing) -> Decision:
        """Go on until all are there."""
        count = len(standing.own)
        return Decision(min(count + PRUNER_STEP, self.most) if count else 0)


def sizing_of(definition: StudyDefinition) -> Sizing:
    """Return the sizing that a definition asks for."""
    gtf = definition.gtf
    if definition.search.pruner == "wilcoxon":
        return PrunerSizing(gtf.noisy_runs_max)
    if gtf.noisy_runs_min < gtf.noisy_runs_max:
        return AdaptiveSizing(gtf.noisy_runs_min, gtf.noisy_runs_max, gtf.aggregate)
    return FixedSizing(gtf.noisy_runs_max)
