"""Choose on which images to search, and with how many runs a trial, so that everything ends within the minutes."""

import math
from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Protocol

from gtf_tune.study.tune.budget import Budget, Plan, Reduction, RunPrice

_ESTIMATED = 0.6
"""Share of the time below which no other images are tried than those of the nominal model."""

_SAFETY = 1.15
"""How many times as long as estimated something may take when it is said how many minutes would suffice."""


class Prices(Protocol):
    """What choosing needs to know of runs with the nominal options on reduced images."""

    of_model: Reduction

    @property
    def reductions(self) -> tuple[Reduction, ...]:
        """Reductions that leave different images, the weakest first."""
        ...

    def price(self, reduction: Reduction) -> RunPrice:
        """Return what a run costs there, as far as it is known."""
        ...

    def measured(self, reduction: Reduction) -> RunPrice:
        """Return what a run costs there, measured now unless it was before."""
        ...

    def misleads(self, reduction: Reduction) -> bool:
        """Whether nominal gives another trajectory there than in its model; takes a run."""
        ...

    def stored(self, reduction: Reduction) -> int:
        """Return how many runs of the nominal trial there are stored already."""
        ...


@dataclass(frozen=True)
class TooLittleTime:
    """The minutes buy no comparison: not even the nominal trial and one other.

    ``spent_s`` are the seconds of what was done, which is stored, ``more_s`` about those that a comparison takes.
    """

    spent_s: float
    more_s: float

    @property
    def minutes(self) -> int:
        """Return the minutes that would have sufficed."""
        return math.ceil((self.spent_s + self.more_s) / 60)

    @property
    def more_minutes(self) -> int:
        """Return the minutes that suffice when the command is called again."""
        return math.ceil(self.more_s / 60)


def choose(prices: Prices, full: RunPrice, budget: Budget, left_s: Callable[[], float]) -> Plan | TooLittleTime:
    """Return the plan on the most and largest images that can be compared in time.

    Images on which nominal gives another trajectory are left out. Nothing is timed that cannot end in time by what is
    known so far: if nothing can be compared, that is returned before the time is spent.

    Parameters
    ----------
    prices
        What runs cost.
    full
        The price on the images of the written models.
    budget
        The whole time of the command, and what a trial is made of.
    left_s
        Returns the seconds that are left of it.
    """
    usable, refused = list(prices.reductions), set[Reduction]()
    while usable:
        reduction = replace(budget, seconds=left_s()).plan(full, prices.price, usable).reduction
        usable.remove(reduction)
        if _least_s(budget, prices, full, reduction) > left_s():
            continue
        if prices.misleads(reduction):
            refused.add(reduction)
            if left_s() < _ESTIMATED * budget.seconds:
                usable = [other for other in usable if other == prices.of_model]
            continue
        price = prices.measured(reduction)
        if _least_s(budget, prices, full, reduction) <= left_s():
            now = replace(budget, seconds=left_s(), stored=prices.stored(reduction))
            return now.plan(full, {reduction: price}.__getitem__, [reduction])
    known = (reduction for reduction in prices.reductions if reduction not in refused)
    least_s = min(_least_s(budget, prices, full, reduction) for reduction in known)
    return TooLittleTime(budget.seconds - left_s(), _SAFETY * least_s)


def _least_s(budget: Budget, prices: Prices, full: RunPrice, reduction: Reduction) -> float:
    """Return the seconds without which nothing is compared there, with the run that is timed before, on its own."""
    fewest, stored, price = min(budget.noisy, budget.fewest_noisy), prices.stored(reduction), prices.price(reduction)
    timing_s = 0.0 if stored else price.whole_s
    return timing_s + replace(budget, noisy=fewest, stored=max(stored, 1)).least_s(price, full)
