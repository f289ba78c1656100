"""Write docs/results.md: what to expect, sequence by sequence, and how often it was wrong."""

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from experiments.bank.bank import Bank
from experiments.bank.draw import block, paired_ratios, run_errors
from experiments.bank.page import FIXED_RULE, HINDSIGHT
from experiments.bank.plan import HUBER, SIGMAS
from experiments.bank.replay import CLEARLY, Replayed, interval, nominal_truth, sound
from experiments.numbers import part, percent

LED, LONGER, ALONE = (f"race of 5, {what}" for what in ("1 x 1, lead 5%", "1 x 3, lead 5%", "1 x 1"))
_MISSED = 0.05

_HEAD = """# Results

Written by `python -m experiments.bank replay` from the runs of [the bank](bank.md) and from the confirmations of
[the appendix](results-appendix.md), which has the paper's experiments grid by grid. Every true error is against ground
truth, which no rule sees, and on noisy copies of the images that the rule did not see."""

_ABOUT_SEQUENCES = (
    f"Nominal is its true ATE in per mille of the extent. `huber 0.05` sets `{HUBER}` to 0.05. Then follow what the "
    "race adopts most often and what it changes, in the mean over its draws; what one configuration for all would have "
    "changed; and the best one, which nobody can know."
)


def results_page(bank: Bank, found: Sequence[Replayed], fresh: Sequence[Mapping[str, Any]]) -> str:
    """Return the page; ``fresh`` are the candidates of confirmations as docs/results.json has them."""
    by_name, places = {one.rule: one for one in found}, sound(bank)
    parts = [_HEAD, _expectations(bank, by_name, places, fresh), _sequences(bank, by_name, places)]
    return "\n\n".join([*parts, _wrong(bank, by_name, places)]) + "\n"


def _expectations(
    bank: Bank, by_name: Mapping[str, Replayed], places: Sequence[int], fresh: Sequence[Mapping[str, Any]]
) -> str:
    led, longer = by_name[LED], by_name[LONGER]
    rendered = sum(bank.sequences[place].startswith("room-") for place in places)
    adopted = [one for one in fresh if one["is_adopted"]]
    worse = [one["clean"] for one in adopted if one["clean"] > CLEARLY]
    lines = [
        "## What to expect on your images",
        "",
        f"* **The first verdict**, from one clean and one noisy run of nominal and four other configurations, changes "
        f"the true ATE by {percent(float(led.values(places).mean()))} in the mean over {len(places)} sequences "
        f"({rendered} of them rendered), 90 % interval {_interval(bank, led, places)}, median "
        f"{percent(float(np.median(led.values(places))))}. It is better than nominal by more than {CLEARLY:.0%} on "
        f"{led.better(places)} sequences and worse by as much on {led.worse(places)}; the worst is "
        f"{percent(float(led.values(places).max()))}. It costs {np.median(list(led.prices.values())):.1f} plain runs.",
        f"* With three noisy runs it is {percent(float(longer.values(places).mean()))} over the "
        f"{len(longer.values(places))} sequences that have enough runs, for "
        f"{np.median(list(longer.prices.values())):.1f} plain runs.",
        f"* **Most of that needs no runs at all**: the configuration that is best on the other sequences changes "
        f"{percent(float(by_name[FIXED_RULE].values(places).mean()))} by itself, the best one of each sequence "
        f"{percent(float(by_name[HINDSIGHT].values(places).mean()))}. What is measured on your images is worth the "
        "difference, and the knowledge whether that configuration suits them.",
        f"* **A confirmation** adopts less, and is wrong less often: of {len(fresh)} candidates in the appendix it "
        f"adopted {len(adopted)}, of which {len(worse)} "
        f"{'was' if len(worse) == 1 else 'were'} worse than nominal on the clean images by more than {CLEARLY:.0%}"
        f"{f' ({percent(max(worse))} at worst)' if worse else ''}. Equal configurations are adopted in at most 4 % of "
        "the [simulations](simulations.md).",
        "* Images that the bank does not have may behave otherwise: large photo collections, unknown focal lengths and "
        "other programs than GLOMAP are not in these figures.",
    ]
    return "\n".join(lines)


def _sequences(bank: Bank, by_name: Mapping[str, Replayed], places: Sequence[int]) -> str:
    columns = ["sequence", "frames", "nominal", "adopted most often", "change", "one for all", "best"]
    rows = [
        [
            bank.sequences[place],
            f"{bank.frames[place]:.0f}",
            f"{1000 * nominal_truth(bank, place):.2f}",
            bank.labels[_usual(by_name[LED], place)],
            *(percent(by_name[name].changes[place]) for name in (LED, FIXED_RULE, HINDSIGHT)),
        ]
        for place in places
    ]
    return part("By sequence", _ABOUT_SEQUENCES, (columns, rows))


def _wrong(bank: Bank, by_name: Mapping[str, Replayed], places: Sequence[int]) -> str:
    led, best = by_name[LED].changes, by_name[HINDSIGHT].changes
    worse = [place for place in places if led[place] > CLEARLY]
    missed = [place for place in places if led[place] - best[place] > _MISSED and place not in worse]
    alone = by_name[ALONE]
    lines = ["## How often it was wrong", ""]
    lines += [
        f"* **{bank.sequences[place]}**: {percent(led[place])}, although the score of what is adopted is "
        f"{percent(_score_change(bank, place, _usual(by_name[LED], place)))} by all runs of the bank. More runs say "
        "the same: the score itself misleads here, and no confirmation would notice."
        for place in worse
    ]
    if missed:
        named = ", ".join(
            f"{bank.sequences[place]} ({percent(led[place])} of {percent(best[place])})" for place in missed
        )
        lines.append(
            f"* More than {_MISSED:.0%} of nominal's error was left where another configuration is best: {named}."
        )
    lines.append(
        f"* Without the lead of the usual configuration the same runs adopt what changes "
        f"{percent(float(alone.values(places).mean()))} in the mean: the smallest of a few scores is too often luck."
    )
    lines.append(
        f"* The aim that nothing adopted is worse than nominal by more than {CLEARLY:.0%} is "
        f"{'missed on ' + str(len(worse)) + ' of ' + str(len(places)) + ' sequences' if worse else 'met'}."
    )
    return "\n".join(lines)


def _usual(found: Replayed, place: int) -> int:
    picks = found.picks[place]
    return max(picks, key=lambda number: picks[number])


def _score_change(bank: Bank, place: int, configuration: int) -> float:
    known = block(bank, place)
    if known is None:
        return float("nan")
    noisy = known.noisy[SIGMAS[0]].tolist()
    errors = run_errors(bank, place, [0, configuration], known.clean.tolist(), noisy)
    return float(np.expm1(paired_ratios(errors)[1]))


def _interval(bank: Bank, found: Replayed, places: Sequence[int]) -> str:
    low, high = interval(bank, found, places)
    return f"{percent(low)} to {percent(high)}"
