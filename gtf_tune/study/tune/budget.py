"""Turn minutes into a plan: how many trials, how long a confirmation, on how many and how large images.

The price of everything follows from one timed run of nominal. A copy of the images (clean with one seed, or noisy)
costs a whole run the first time; after that a configuration that only repeats the last stage costs that stage alone.
"""

import math
from dataclasses import dataclass

CLEAN_RUNS = 1
NOISY_RUNS = 3
"""Runs of a trial: few, because the noise is common to all trials."""

CONFIRMED = 2
"""Candidates that a confirmation compares with nominal."""

FEWEST_CONFIRMATION_RUNS = 4
MOST_CONFIRMATION_RUNS = 16
MOST_TRIALS = 60
_FEWEST_TRIALS = 4

ABLATIONS = 2
"""Trials that are kept for putting options of the best one back to nominal."""

_SEARCH_SHARE = 0.6
"""Share of what is left after the first trials that goes to the search; the rest goes to the confirmation."""

_IN_TIME = 0.9
"""Share of the minutes that is planned for: runs of one machine differ in time."""


@dataclass(frozen=True)
class RunPrice:
    """What one run costs, in seconds of one core.

    ``whole_s`` is a run from the pixels on; ``repeated_s`` one whose cached stages are at hand, and ``verified_s`` one
    that has features and matches only.
    """

    whole_s: float
    repeated_s: float
    verified_s: float = 0.0

    def scaled(self, reduction: "Reduction") -> "RunPrice":
        """Return the estimated price on fewer and smaller images.

        Matching grows with the square of the number of images, everything else about linearly with their number; the
        number of features follows the area. The larger exponent is taken for cached stages, which matching rules.
        """
        area = reduction.size**2
        cached = self.whole_s - self.repeated_s
        return RunPrice(
            cached * reduction.frames**1.5 * area + self.repeated_s * reduction.frames * area,
            self.repeated_s * reduction.frames * area,
            (self.verified_s - self.repeated_s) * reduction.frames**1.5 * area
            + self.repeated_s * reduction.frames * area,
        )


@dataclass(frozen=True)
class Reduction:
    """Share of the frames and of the width that the search uses; 1 is all."""

    frames: float = 1.0
    size: float = 1.0


REDUCTIONS = (Reduction(), Reduction(size=0.5), Reduction(frames=1 / 2, size=0.5), Reduction(frames=1 / 3, size=0.5))
"""What is tried in this order until the minutes suffice."""


@dataclass(frozen=True)
class Plan:
    """What the minutes buy.

    ``trials`` counts nominal. ``confirmation_runs`` are noisy runs of each configuration; 0 where there is no time for
    a confirmation. ``search_s``, ``confirm_s`` and ``write_s`` are the estimated wall times of the phases,
    ``price`` and ``full`` what a run costs in the search and on all images at full size.
    """

    trials: int
    confirmation_runs: int
    reduction: Reduction
    search_s: float
    confirm_s: float
    write_s: float
    price: RunPrice = RunPrice(0.0, 0.0)
    full: RunPrice = RunPrice(0.0, 0.0)

    @property
    def seconds(self) -> float:
        """Return the estimated wall time of all phases together."""
        return self.search_s + self.confirm_s + self.write_s


@dataclass(frozen=True)
class Budget:
    """What is available: wall time in seconds and runs at a time.

    ``first`` configurations are always tried, and ``baselines`` are confirmed beside the best ones. ``most_trials``
    counts nominal.
    """

    seconds: float
    jobs: int
    first: int
    baselines: int = 0
    most_trials: int = MOST_TRIALS

    def plan(self, full: RunPrice, reduced: RunPrice | None = None, reduction: Reduction | None = None) -> Plan:
        """Return the plan for these prices.

        ``full`` is the price on all images at full size, which the written models cost; ``reduced`` the price that was
        measured on reduced images. Without it the first reduction whose estimated price fits is taken.
        """
        if reduced is not None:
            return self._plan(full, reduced, reduction or Reduction())
        plans = [self._plan(full, full.scaled(reduction), reduction) for reduction in REDUCTIONS]
        return next((plan for plan in plans if self._fits(plan)), plans[-1])

    def _plan(self, full: RunPrice, price: RunPrice, reduction: Reduction) -> Plan:
        write = self.write_s(full)
        first = self._first_trials(price)
        left = _IN_TIME * self.seconds - write - first
        runs = self._confirmation_runs(price, left)
        confirm = self.confirmation_s(price, runs)
        more = self._more_trials(price, left - confirm)
        search = first + self._parallel((more + ABLATIONS) * self._trial(price))
        return Plan(1 + self.first + more, runs, reduction, search, confirm, write, price, full)

    def affordable_confirmation(self, price: RunPrice, left_s: float) -> int:
        """Return how many noisy runs a confirmation may have that ends within some seconds; 0 where it cannot be."""
        counts = range(MOST_CONFIRMATION_RUNS, FEWEST_CONFIRMATION_RUNS - 1, -1)
        return next((runs for runs in counts if self.confirmation_s(price, runs) <= left_s), 0)

    def _confirmation_runs(self, price: RunPrice, left: float) -> int:
        """Return the noisy runs of a confirmation: what its share of the time buys, at least the fewest if they fit."""
        for runs in range(MOST_CONFIRMATION_RUNS, FEWEST_CONFIRMATION_RUNS - 1, -1):
            share = left if runs == FEWEST_CONFIRMATION_RUNS else (1 - _SEARCH_SHARE) * left
            if self.confirmation_s(price, runs) <= share:
                return runs
        return 0

    def _more_trials(self, price: RunPrice, left: float) -> int:
        trial = self._parallel(self._trial(price))
        affordable = math.floor(max(left, 0.0) / trial) - ABLATIONS if trial > 0 else self.most_trials
        fewest = max(_FEWEST_TRIALS - 1 - self.first, 0)  # the search ends by the clock in any case
        return min(max(affordable, fewest), max(self.most_trials - 1 - self.first, 0))

    def _fits(self, plan: Plan) -> bool:
        return plan.confirmation_runs > 0 and plan.seconds <= _IN_TIME * self.seconds

    def trial_s(self, price: RunPrice) -> float:
        """Return the estimated wall time of one more trial."""
        return self._parallel(self._trial(price))

    def _trial(self, price: RunPrice) -> float:
        return (CLEAN_RUNS + NOISY_RUNS) * price.repeated_s

    def _first_trials(self, price: RunPrice) -> float:
        """Return the wall time of nominal, whose runs begin at the pixels, and of the first configurations."""
        copies = CLEAN_RUNS + NOISY_RUNS
        return self._parallel(copies * price.whole_s + self.first * self._trial(price))

    def confirmation_s(self, price: RunPrice, runs: int) -> float:
        """Return the estimated wall time of a confirmation with so many noisy runs of each configuration."""
        copies = CLEAN_RUNS + runs
        each = price.whole_s + CONFIRMED * price.repeated_s + self.baselines * price.verified_s
        return self._parallel(copies * each) if runs else 0.0

    def write_s(self, full: RunPrice) -> float:
        """Return the estimated wall time of the reconstructions: nominal, and adopted from the same matches."""
        return full.whole_s + (full.verified_s or full.whole_s)

    def _parallel(self, seconds: float) -> float:
        return seconds / self.jobs
