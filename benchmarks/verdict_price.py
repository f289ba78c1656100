"""Say what a verdict costs in plain runs: one with nominal options and nothing cached.

Prices follow from the processor times of the stages, as the bank of runs keeps them, and from how many runs share which
stages.
"""

from dataclasses import dataclass, fields

import numpy as np

from benchmarks.section import Aim, Effort, Section, median
from experiments.bank.bank import STAGES, Bank, load
from gtf_tune.pipelines.preset_spaces import preset_space

SHOWN = ("fountain-P11", "dtu-scan24", "kitti06", "nerf-lego", "tum-fr3-office", "room-6")
"""Sequences with a row of their own: different cameras and motions, and one of the rendered rooms."""

OLD_COMMIT = "c522078"
"""The last commit with the old defaults: noise ladder, 2 x 6 runs a trial, 18 runs of each of four configurations."""

_FRONT = len(("images", "features", "matches"))
_LADDER_RUNS = 22
_TRIALS = 20
_FIRST = 1 + len(preset_space("glomap").first)


@dataclass(frozen=True)
class Stages:
    """Processor seconds of one run: what a copy of the images costs, then its verification, then a mapping."""

    front: float
    middle: float
    mapping: float

    @property
    def plain(self) -> float:
        """Seconds of a plain run."""
        return self.front + self.middle + self.mapping

    def price(self, copies: tuple[int, int], configurations: int, *, clean_images: bool = True) -> float:
        """Return the price in plain runs of configurations on so many clean and noisy copies, all of one verification.

        Clean copies have the same images; ``clean_images`` says whether their features and matches are to be made.
        """
        clean, noisy = copies
        fronts, all_copies = noisy + int(clean_images), clean + noisy
        seconds = fronts * self.front + all_copies * (self.middle + configurations * self.mapping)
        return seconds / self.plain


@dataclass(frozen=True)
class Prices:
    """Prices in plain runs of the first verdict, of search and confirmation now, and of both by the old defaults."""

    first: float
    search: float
    one_look: float
    all_looks: float
    old: float


def prices(stages: Stages) -> Prices:
    """Return the prices on a sequence by the defaults of `tune`: 1 x 3 runs a trial, three configurations confirmed."""
    ladder = stages.price((2, _LADDER_RUNS - 2), 1, clean_images=False)
    old_search = stages.price((2, 6), _TRIALS)
    return Prices(
        first=stages.price((1, 3), _FIRST),
        search=stages.price((1, 3), _TRIALS),
        one_look=stages.price((1, 4), 3, clean_images=False),
        all_looks=stages.price((1, 16), 3, clean_images=False),
        old=ladder + old_search + stages.price((2, 16), 4, clean_images=False),
    )


def stages_of(bank: Bank, place: int) -> Stages:
    """Return the seconds of the stages on one sequence; a mapping is the mean over configurations."""
    seconds = bank.seconds[place]
    middle = float(seconds[0, _FRONT : len(STAGES) - 1].sum())
    return Stages(float(seconds[0, :_FRONT].sum()), middle, float(np.nanmean(seconds[:, -1])))


def run(effort: Effort) -> Section:
    del effort
    bank = load()
    found = {name: stages_of(bank, place) for place, name in enumerate(bank.sequences)}
    rows = {name: _cells(prices(stages)) for name, stages in found.items()}
    every = [prices(stages) for stages in found.values()]
    middle = Prices(*(median([getattr(one, field.name) for one in every]) for field in fields(Prices)))
    worst = Prices(*(max(getattr(one, field.name) for one in every) for field in fields(Prices)))
    whole = [one.search + one.one_look for one in every]
    pairing = [_pairing(bank, place) / one.search for place, one in enumerate(every)]
    return Section(
        title="Price of a verdict in plain runs",
        text=(
            "A plain run is one cold run with nominal options. Prices are sums of processor times of stages, which the "
            "bank of runs measured one run after the other, by the numbers of copies and configurations that share "
            f"them; processor time of gtf-tune itself is not in them (see the overhead above). {_FIRST} trials end "
            f"with the first verdict, {_TRIALS} with the search, each of 1 clean and 3 noisy runs, all on the same "
            "copies; nominal and two candidates are confirmed on 4 (one look) to 16 fresh copies (four looks). The "
            f"old defaults are those of commit {OLD_COMMIT}: a noise ladder of {_LADDER_RUNS} runs, {_TRIALS} trials "
            "of 2 clean and 6 noisy runs, and nominal and three candidates on 18 fresh copies. Studies by the old "
            "defaults on nine sequences that are not in the bank took 44 to 80 plain runs, 64 in the median. How "
            "good what is adopted is stands in [the bank](bank.md)."
        ),
        header=(
            "sequence",
            "plain run",
            "first verdict",
            "search",
            "confirmed, one look",
            "four looks",
            "old defaults",
        ),
        rows=(
            *((name, f"{found[name].plain:.1f} s", *rows[name]) for name in SHOWN),
            (f"median of {len(every)}", f"{median([one.plain for one in found.values()]):.1f} s", *_cells(middle)),
            ("worst", f"{max(one.plain for one in found.values()):.1f} s", *_cells(worst)),
        ),
        aims=(
            _aim("first verdict within 8 plain runs in the median", middle.first, 8),
            _aim("search and a confirmation that ends at its first look within 15 in the median", median(whole), 15),
            _aim("search and a confirmation that ends at its first look within 25 at worst", max(whole), 25),
        ),
        conclusion=(
            f"Matching and verifying the noisy copies is {median(pairing):.0%} of the price of the search in the "
            f"median and {max(pairing):.0%} at most: to match them only over pairs that verified on the clean images "
            "would save no more than a part of that."
        ),
    )


def _pairing(bank: Bank, place: int) -> float:
    """Return the price in plain runs of matching and verifying the noisy copies of a search."""
    seconds = bank.seconds[place, 0]
    return float(3 * seconds[[STAGES.index("matches"), STAGES.index("geometry")]].sum() / seconds.sum())


def _cells(found: Prices) -> tuple[str, ...]:
    totals = (found.first, found.search, found.search + found.one_look, found.search + found.all_looks, found.old)
    return tuple(f"{price:.1f}" for price in totals)


def _aim(wanted: str, price: float, most: float) -> Aim:
    bound = f"Fewer trials cost less: each of the {_TRIALS} repeats four mappings."
    return Aim(wanted, f"{price:.1f}", met=price <= most, bound="" if price <= most else bound)
