"""Measure what adaptive sizing spares and what it loses, by races of simulated trials against an incumbent.

Log scores of an instance are the luck that all settings share, plus the setting's own. On dtu-scan24 with GLOMAP (16
instances, sigma 2) the first spreads by 0.5 and the paired differences by 0.06 to 0.18; here by 0.5 and 0.14. With
collapses one noisy run in twenty of the challenger is 50 times worse.
"""

from dataclasses import dataclass

import numpy as np

from benchmarks.section import Effort, Section
from gtf_tune.study.scoring.early_stopping import SIGNIFICANCE, AdaptiveSizing, Sizing

SHARED, OWN = 0.5, 0.1
COLLAPSE_RATE, COLLAPSE_FACTOR = 0.05, 50.0
CHANGES = (-0.2, -0.1, 0.0, 0.05, 0.2, 1.0)
CHOSEN = AdaptiveSizing(3, 12, "median", SIGNIFICANCE)
RULES = (
    CHOSEN,
    AdaptiveSizing(3, 12, "median", 0.05),
    AdaptiveSizing(3, 12, "median", 0.2),
    AdaptiveSizing(2, 12, "median", SIGNIFICANCE),
    AdaptiveSizing(4, 12, "median", SIGNIFICANCE),
    AdaptiveSizing(3, 24, "median", SIGNIFICANCE),
)


@dataclass(frozen=True)
class Races:
    """The outcome of many races: the share that was stopped, and the noisy runs that one took on average."""

    stopped: float
    runs: float


def race(sizing: Sizing, change: float, collapse_rate: float, generator: np.random.Generator) -> tuple[bool, int]:
    """Run one challenger whose score is ``change`` higher than the incumbent's, and return whether it was stopped."""
    most = sizing.first(is_nominal=True)
    luck = SHARED * generator.standard_normal(most)
    incumbent = np.exp(luck + OWN * generator.standard_normal(most))
    own = (1.0 + change) * np.exp(luck + OWN * generator.standard_normal(most))
    own = np.where(generator.random(most) < collapse_rate, COLLAPSE_FACTOR * own, own)
    count = sizing.first(is_nominal=False)
    while True:
        decision = sizing.next(own[:count].tolist(), incumbent.tolist())
        if decision.noisy_runs <= count:
            return decision.hopeless, count
        count = decision.noisy_runs


def races(sizing: Sizing, change: float, collapse_rate: float, count: int) -> Races:
    generator = np.random.default_rng(1)
    found = [race(sizing, change, collapse_rate, generator) for _ in range(count)]
    return Races(float(np.mean([stopped for stopped, _ in found])), float(np.mean([runs for _, runs in found])))


def run(effort: Effort) -> Section:
    count = effort.pick(300, 3000)
    rows = [_row(rule, collapse_rate, count) for rule in RULES for collapse_rate in (0.0, COLLAPSE_RATE)]
    return Section(
        title="What adaptive sizing spares",
        text=(
            f"{count} simulated races of a challenger against an incumbent for each cell: share of challengers that "
            "are stopped early / noisy runs that a challenger takes on average. Columns: by how much the challenger's "
            "score is truly higher. To stop one that is 10 or 20 % better is the error that matters."
        ),
        header=("min-max, p", "collapses", *(f"{change:+.0%}" for change in CHANGES)),
        rows=tuple(rows),
        conclusion=(
            f"The default is min = {CHOSEN.least}, max = {CHOSEN.most}, p = {CHOSEN.significance:g} (first rows). A "
            "stricter p spends more runs on settings that are slightly worse; a looser one gives up more settings that "
            "are as good or a little better, and min = 2 gives up much better ones where runs collapse: of two "
            "ratios nobody can say which is the odd one. Compare with the table of searches: near the optimum most "
            "challengers are as good as the incumbent, and those take nearly all runs."
        ),
    )


def _row(rule: AdaptiveSizing, collapse_rate: float, count: int) -> tuple[str, ...]:
    found = [races(rule, change, collapse_rate, count) for change in CHANGES]
    cells = (f"{100 * one.stopped:.0f} % / {one.runs:.1f}" for one in found)
    return (f"{rule.least}-{rule.most}, {rule.significance:g}", f"{collapse_rate:.0%}", *cells)
