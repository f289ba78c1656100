"""Turn minutes into a plan: how many trials, how long a confirmation, on how many and how large images.

Everything here is arithmetic on prices that were measured. A copy of the images (clean with one seed, or noisy) costs
a whole run the first time; after that a configuration repeats only the stages from its first changed option on. The
same function plans before the search and anew after every trial of it: too little time shortens the search first and
then the confirmation.
"""

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, fields, replace

CLEAN_RUNS = 1
NOISY_RUNS = 3
"""Runs of a trial: few, because the noise is common to all trials."""

FEWEST_NOISY_RUNS = 1
"""Noisy runs of a trial where more would leave too few trials: they rank nearly as well (docs/bank.md)."""

CONFIRMED = 2
"""Candidates that a confirmation compares with nominal."""

FEWEST_CONFIRMATION_RUNS = 4
MOST_CONFIRMATION_RUNS = 16
MOST_TRIALS = 60
FEWEST_TRIALS = 4
"""Trials, nominal included, that are made before there is anything to confirm."""

ABLATIONS = 2
"""Trials that are kept for putting options of the best one back to nominal."""

_SEARCH_SHARE = 0.6
"""Share of what is left after the nominal trial that goes to the search; the rest goes to the confirmation."""

_SLACK = 1.15
"""How much longer than its price a confirmation or a reconstruction may take: once begun it cannot be shortened."""

AROUND_S = 15.0
"""Seconds for starting, for the report and for ending."""


@dataclass(frozen=True)
class RunPrice:
    """What one run costs, in seconds of one core.

    ``whole_s`` is a run from the pixels on; ``repeated_s`` what a configuration of the search repeats of it, and
    ``verified_s`` a run that has features and matches only.
    """

    whole_s: float
    repeated_s: float
    verified_s: float = 0.0

    def times(self, factor: float) -> "RunPrice":
        """Return the price where everything takes ``factor`` times as long."""
        return RunPrice(factor * self.whole_s, factor * self.repeated_s, factor * self.verified_s)

    def between(self, other: "RunPrice", share: float) -> "RunPrice":
        """Return the price between this one and another, in proportion of logarithms: 0 is this one, 1 the other."""
        return RunPrice(
            *(_between(getattr(self, field.name), getattr(other, field.name), share) for field in fields(RunPrice))
        )


def _between(first: float, second: float, share: float) -> float:
    if min(first, second) <= 0:
        return first + share * (second - first)
    return math.exp((1 - share) * math.log(first) + share * math.log(second))


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
    ``price`` and ``full`` what a run costs in the search and on the images of the written models; there
    ``repeated_s`` is the second reconstruction. A trial has so many ``noisy`` runs.
    """

    trials: int
    confirmation_runs: int
    reduction: Reduction
    search_s: float
    confirm_s: float
    write_s: float
    price: RunPrice = RunPrice(0.0, 0.0)
    full: RunPrice = RunPrice(0.0, 0.0)
    noisy: int = NOISY_RUNS

    @property
    def seconds(self) -> float:
        """Return the estimated wall time of all phases together."""
        return self.search_s + self.confirm_s + self.write_s


@dataclass(frozen=True)
class Ahead:
    """What is still to be done: further trials, a confirmation, and how long each phase takes.

    The confirmation compares so many ``candidates`` and ``baselines`` with nominal, under ``confirmation_runs`` noisy
    runs each; 0 where there is no time for one.
    """

    trials: int
    candidates: int
    baselines: int
    confirmation_runs: int
    search_s: float
    confirm_s: float
    write_s: float


@dataclass(frozen=True)
class Budget:
    """What is available: wall time in seconds and runs at a time.

    ``first`` configurations are tried before others, and ``baselines`` are confirmed beside the best ones.
    ``most_trials`` counts nominal; a confirmation has so many ``candidates``. A trial has ``noisy`` runs beside its
    ``clean`` ones, ``fewest_noisy`` where time is short; so many of nominal's are ``stored`` already.
    """

    seconds: float
    jobs: int
    first: int
    baselines: int = 0
    candidates: int = CONFIRMED
    most_trials: int = MOST_TRIALS
    noisy: int = NOISY_RUNS
    clean: int = CLEAN_RUNS
    stored: int = 0
    fewest_noisy: int = FEWEST_NOISY_RUNS

    @property
    def copies(self) -> int:
        """Return how many runs a trial has."""
        return self.clean + self.noisy

    @property
    def nominal_runs(self) -> int:
        """Return how many runs of nominal are still to be made."""
        return max(self.copies - self.stored, 0)

    def nominal_s(self, price: RunPrice) -> float:
        """Return the estimated wall time of the nominal trial, or of what is left of it."""
        return self.waves(self.nominal_runs) * price.whole_s

    def model_s(self, full: RunPrice) -> float:
        """Return the estimated wall time of the second model: matches are verified anew where a baseline is adopted."""
        return max(full.repeated_s, full.verified_s) if self.baselines else full.repeated_s

    def least_s(self, price: RunPrice, full: RunPrice) -> float:
        """Return the seconds without which nothing is compared: the nominal trial, another one, and its model."""
        return self.nominal_s(price) + self.trial_s(price) + _SLACK * full.repeated_s + AROUND_S

    def plan(
        self, full: RunPrice, price_of: Callable[[Reduction], RunPrice], usable: Sequence[Reduction] = REDUCTIONS
    ) -> Plan:
        """Return the plan on as many and as large images as the time allows, of those that are ``usable``.

        Trials with one noisy run come before fewer or smaller images. ``full`` is the price on the images of the
        written models, ``price_of`` returns that of a run in the search.
        """
        counts = dict.fromkeys([self.noisy, min(self.noisy, self.fewest_noisy)])
        budgets = [(replace(self, noisy=noisy), reduction) for reduction in usable for noisy in counts]
        plans = ((budget, budget.plan_at(full, price_of(reduction), reduction)) for budget, reduction in budgets)
        for budget, plan in plans:
            if budget._fits(plan):
                break
        return plan

    def plan_at(self, full: RunPrice, price: RunPrice, reduction: Reduction) -> Plan:
        """Return the plan for a search on reduced images whose price is known."""
        free = self._free(self.seconds, full) - self.nominal_s(price)
        ahead = self.ahead(price, full, self.seconds, (self.most_trials, self._shared_runs(price, free)))
        trials = 1 + ahead.trials
        seconds = ahead.search_s, ahead.confirm_s, ahead.write_s
        return Plan(trials, ahead.confirmation_runs, reduction, *seconds, price, full, self.noisy)

    def ahead(self, price: RunPrice, full: RunPrice, left_s: float, wanted: tuple[int, int], *, done: int = 0) -> Ahead:
        """Return what can still be done in the seconds that are left.

        ``wanted`` are the trials, nominal included, and the noisy runs of the confirmation; ``done`` of the trials have
        ended. Where time is short the confirmation shrinks to its fewest runs as long as first configurations are
        untried, then the search to its fewest trials, then the confirmation to the best one alone; what remains may be
        too short for any. Time that the search cannot use goes to the confirmation.
        """
        trials, runs = wanted
        nominal_s = 0.0 if done else self.nominal_s(price)
        free, trial_s = self._free(left_s, full) - nominal_s, self.trial_s(price)

        def affordable(noisy: int) -> int:
            left = max(free - _SLACK * self.confirmation_s(price, noisy), 0.0)
            return math.floor(left / trial_s) if trial_s > 0 else self.most_trials + ABLATIONS

        most = max(trials - max(done, 1), 0)
        first, fewest = (min(max(count - max(done, 1), 0), most) for count in (1 + self.first, FEWEST_TRIALS))
        runs = next((count for count in _downwards(runs) if self._has(price, count, free, first)), 0)
        if not runs and self._has(price, FEWEST_CONFIRMATION_RUNS, free, fewest):
            runs = FEWEST_CONFIRMATION_RUNS
        if not runs and self.candidates > 1:
            return replace(self, candidates=1, baselines=0).ahead(price, full, left_s, wanted, done=done)
        spare = affordable(runs)
        more = min(max(spare - ABLATIONS, min(spare, first)), most)
        if runs and more == most:
            enough = (count for count in _downwards() if self._has(price, count, free, most + ABLATIONS))
            runs = max(runs, next(enough, 0))
        shortened = min(ABLATIONS, max(affordable(runs) - more, 0)) if runs else 0
        search_s = nominal_s + (more + shortened) * trial_s
        confirm_s, write_s = self.confirmation_s(price, runs), self.model_s(full) + AROUND_S
        return Ahead(more, self.candidates, self.baselines, runs, search_s, confirm_s, write_s)

    def _has(self, price: RunPrice, runs: int, free: float, trials: int) -> bool:
        """Whether there is time for a confirmation with so many noisy runs after so many trials."""
        return _SLACK * self.confirmation_s(price, runs) + trials * self.trial_s(price) <= free

    def _free(self, left_s: float, full: RunPrice) -> float:
        """Return the seconds that search and confirmation may take together."""
        return left_s - _SLACK * self.model_s(full) - AROUND_S

    def _shared_runs(self, price: RunPrice, free: float) -> int:
        """Return the noisy runs of a confirmation that its share of the free time buys, at least the fewest."""
        share = (1 - _SEARCH_SHARE) * free
        bought = (count for count in _downwards() if _SLACK * self.confirmation_s(price, count) <= share)
        return next(bought, FEWEST_CONFIRMATION_RUNS)

    def _fits(self, plan: Plan) -> bool:
        """Whether a plan has all first configurations and a confirmation with all candidates and baselines."""
        wide = plan.confirm_s >= self.confirmation_s(plan.price, FEWEST_CONFIRMATION_RUNS) > 0
        return wide and plan.trials >= min(1 + self.first, self.most_trials)

    def trial_s(self, price: RunPrice) -> float:
        """Return the estimated wall time of one more trial."""
        return self.waves(self.copies) * price.repeated_s

    def confirmation_s(self, price: RunPrice, runs: int) -> float:
        """Return the estimated wall time of a confirmation with so many noisy runs of each configuration."""
        each = price.whole_s + self.candidates * price.repeated_s + self.baselines * price.verified_s
        return self.waves(self.clean + runs) * each if runs else 0.0

    def waves(self, runs: int) -> int:
        """Return how many times in turn a configuration's runs fill all places."""
        return math.ceil(runs / self.jobs)


def _downwards(most: int = MOST_CONFIRMATION_RUNS) -> range:
    return range(most, FEWEST_CONFIRMATION_RUNS - 1, -1)
