"""Rules that decide from few runs which configuration to adopt; each is a small function of a `Draw`."""

import math
from collections.abc import Callable, Mapping, Sequence
from functools import partial
from types import MappingProxyType
from typing import Literal

import numpy as np
from scipy.special import stdtr

from experiments.bank.draw import Draw, RunCounts, TooFewRunsError, aggregated, paired_ratios, set_aside
from experiments.bank.plan import SIGMAS
from gtf_tune.errors import TrajectoryError
from gtf_tune.gtf import Aggregate
from gtf_tune.gtf.random_effects import compared_table, two_way_spread
from gtf_tune.trajectory import FloatArray

Rule = Callable[[Draw], int]
"""Return the configuration that is adopted; 0 is nominal."""

Scoring = Literal["paired"] | Aggregate

LOOKS = (4, 8, 12, 16)
LEVELS = (0.002, 0.008, 0.018, 0.03)
"""Significance at each look, one-sided, some 0.04 in total as the looks overlap."""


def nominal(draw: Draw) -> int:
    """Adopt nothing."""
    del draw
    return 0


def fixed(draw: Draw) -> int:
    """Adopt the configuration that is best on the other sequences; it costs no runs."""
    means = draw.others.mean_truth[: draw.configurations]
    return 0 if np.isnan(means).all() else int(np.nanargmin(means))


def race(
    draw: Draw,
    size: int,
    runs: RunCounts,
    *,
    scoring: Scoring = "paired",
    sigma: float = SIGMAS[0],
    margin: float = 0.0,
) -> int:
    """Adopt the smallest score of a portfolio, if it beats nominal's by the margin (a share of it)."""
    members = draw.others.portfolio(size, draw.configurations)
    tables = draw.tables(members, runs, sigma)
    ratios = _ratios(tables, scoring)
    best = int(np.argmin(ratios))
    return members[best] if ratios[best] < math.log1p(-margin) else 0


def led(draw: Draw, size: int, runs: RunCounts, *, margin: float) -> int:
    """Adopt the configuration that is best on the other sequences, unless a score is smaller by the margin."""
    leader = fixed(draw)
    members = sorted({*draw.others.portfolio(size, draw.configurations), leader})
    ratios = paired_ratios(draw.tables(members, runs))
    best, place = int(np.argmin(ratios)), members.index(leader)
    return members[best] if ratios[best] - ratios[place] < math.log1p(-margin) else leader


def race_of_clean(draw: Draw, size: int, k: int) -> int:
    """Adopt the portfolio's smallest spread between clean runs of different seeds: no noisy images at all."""
    members = draw.others.portfolio(size, draw.configurations)
    return members[int(np.argmin(np.log(draw.clean_pairs(members, k)).mean(axis=1)))]


def race_of_noisy(draw: Draw, size: int, k_delta: int) -> int:
    """Adopt the portfolio's smallest spread between noisy runs, without clean ones."""
    members = draw.others.portfolio(size, draw.configurations)
    return members[int(np.argmin(np.log(draw.noisy_pairs(members, k_delta)).mean(axis=1)))]


def halving(draw: Draw, size: int, rounds: Sequence[RunCounts], *, margin: float = 0.0) -> int:
    """Race with more runs in each round; the worse half is dropped after it, nominal never."""
    members = list(draw.others.portfolio(size, draw.configurations))
    ratios = np.zeros(len(members))
    for runs in rounds:
        ratios = paired_ratios(draw.tables(members, runs))
        order = np.argsort(ratios, kind="stable")[: max(2, math.ceil(len(members) / 2))]
        kept = sorted({0, *order.tolist()})
        members, ratios = [members[place] for place in kept], ratios[kept]
    best = int(np.argmin(ratios))
    return members[best] if ratios[best] < math.log1p(-margin) else 0


def posterior(draw: Draw, size: int, runs: RunCounts, *, margin: float = 0.0) -> int:
    """Adopt the smallest posterior mean of the true change.

    The prior of a configuration is its mean change on the other sequences; how far its score moves it is their slope
    of true changes over scores, both as deviations from the means of each configuration.
    """
    members = list(draw.others.portfolio(size, draw.configurations))
    observed = paired_ratios(draw.tables(members, runs))
    scores, truth = draw.others.scores(runs)[:, members], draw.others.truth[:, members]
    whole = ~np.isnan(scores + truth).any(axis=1)
    scores, truth = scores[whole], truth[whole]
    if len(scores) < 2:
        return members[int(np.argmin(observed))]
    centred = scores - scores.mean(axis=0)
    slope = float((centred * (truth - truth.mean(axis=0))).sum() / max((centred**2).sum(), 1e-12))
    expected = truth.mean(axis=0) + min(max(slope, 0.0), 1.0) * (observed - scores.mean(axis=0))
    best = int(np.argmin(expected))
    return members[best] if expected[best] < math.log1p(-margin) else 0


def confirmed(draw: Draw, pick: Rule, k: int, *, fallback: Rule = nominal) -> int:
    """Adopt a pick only if it beats nominal at one of the looks at copies that the pick did not see."""
    candidate = pick(draw)
    if candidate == 0:
        return fallback(draw)
    fresh = draw.reversed()
    copies = len(fresh.noisy[SIGMAS[0]])
    if copies < LOOKS[0]:
        raise TooFewRunsError
    for look, level in zip(LOOKS, LEVELS, strict=True):
        if copies < look:
            break
        before, after = set_aside(fresh.tables([0, candidate], (k, look)))
        probability = _probability_of_no_gain(before, after)
        if probability < level:
            return candidate
        if probability > 0.5:
            break
    return fallback(draw)


def by_seen_truth(draw: Draw, size: int, runs: RunCounts) -> int:
    """Adopt the smallest median true error over the same runs as a race: tuning with ground truth."""
    members = draw.others.portfolio(size, draw.configurations)
    return members[int(np.argmin(np.median(draw.true_errors(members, runs), axis=1)))]


def in_hindsight(draw: Draw) -> int:
    """Adopt what is best on the unseen copies themselves, which nobody can know."""
    return int(np.argmin(draw.unseen_truth()))


def _ratios(tables: FloatArray, scoring: Scoring) -> FloatArray:
    if scoring == "paired":
        return paired_ratios(tables)
    scores = np.log(aggregated(tables, scoring))
    return np.asarray(scores - scores[0])


def _probability_of_no_gain(before: FloatArray, after: FloatArray) -> float:
    """Return the one-sided p value of the second table's errors not being smaller; 1 where nothing can be said."""
    try:
        table, _ = compared_table(before, after)
    except TrajectoryError:
        return 1.0
    spread, mean = two_way_spread(table), float(table.mean())
    if spread.variance <= 0:
        return 0.0 if mean < 0 else 1.0
    return float(stdtr(spread.freedom, mean / math.sqrt(spread.variance)))


ALL = 99
"""A size larger than any number of configurations."""


def _references() -> dict[str, Rule]:
    found: dict[str, Rule] = {"nominal": nominal, "best fixed configuration": fixed, "hindsight": in_hindsight}
    for size in (5, ALL):
        for runs in ((1, 1), (2, 3)):
            found[f"ground truth, {_sized(size, runs)}"] = partial(by_seen_truth, size=size, runs=runs)
    return found


def _races() -> dict[str, Rule]:
    found: dict[str, Rule] = {}
    for size in (3, 5, 8, ALL):
        for runs in ((1, 1), (1, 3), (2, 3), (2, 6)):
            found[f"race of {_sized(size, runs)}"] = partial(race, size=size, runs=runs)
    five = partial(race, size=5)
    for scoring in ("median", "mean", "gmean"):
        found[f"race of 5, 2 x 3, {scoring}"] = partial(five, runs=(2, 3), scoring=scoring)
    for runs in ((1, 1), (1, 3), (2, 3)):
        found[f"race of {_sized(5, runs)}, sigma {SIGMAS[1]:g}"] = partial(five, runs=runs, sigma=SIGMAS[1])
    for margin in (0.1, 0.3):
        found[f"race of 5, 1 x 3, margin {margin:.0%}"] = partial(five, runs=(1, 3), margin=margin)
    return found


def _others() -> dict[str, Rule]:
    found: dict[str, Rule] = {}
    for k in (2, 4):
        found[f"race of 5, {k} clean runs"] = partial(race_of_clean, size=5, k=k)
    found["race of 5, 3 noisy runs"] = partial(race_of_noisy, size=5, k_delta=3)
    for size in (8, ALL):
        rounds = ((1, 1), (1, 2), (2, 3))
        found[f"halving of {'all' if size == ALL else size}, 1 x 1 to 2 x 3"] = partial(
            halving, size=size, rounds=rounds
        )
    for size in (5, ALL):
        for runs in ((1, 1), (1, 3), (2, 3)):
            found[f"posterior of {_sized(size, runs)}"] = partial(posterior, size=size, runs=runs)
    found["posterior of 5, 1 x 1, margin 5%"] = partial(posterior, size=5, runs=(1, 1), margin=0.05)
    for runs in ((1, 1), (1, 3), (2, 3)):
        for margin in (0.05, 0.1, 0.2):
            name = f"race of {_sized(5, runs)}, lead {margin:.0%}"
            found[name] = partial(led, size=5, runs=runs, margin=margin)
    first = partial(race, size=5, runs=(1, 1))
    found["race of 5, 1 x 1, confirmed"] = partial(confirmed, pick=first, k=2)
    found["race of 5, 1 x 1, confirmed or fixed"] = partial(confirmed, pick=first, k=2, fallback=fixed)
    return found


def _sized(size: int, runs: RunCounts) -> str:
    return f"{'all' if size == ALL else size}, {runs[0]} x {runs[1]}"


RULES: Mapping[str, Rule] = MappingProxyType(_references() | _races() | _others())
"""The rules that are compared, by name: size of the portfolio, clean x noisy runs, and what differs from a race."""
