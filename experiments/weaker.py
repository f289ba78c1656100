"""Compare grids under the usual and under weaker noise."""

from collections.abc import Sequence
from typing import NamedTuple

from experiments.findings import WORTH_FINDING, share_of_oracle
from experiments.numbers import Table, mean, percent, plain, share
from experiments.plan import AGGREGATE
from experiments.settings import PREDICTORS, Agreement, Outcome

_REGRESSION = 0.01


class NoisePair(NamedTuple):
    """One grid under the usual and under weaker noise."""

    usual: Outcome
    weaker: Outcome


class Standing(NamedTuple):
    """Say what a noise is worth over grids: mean rank correlation, picks worse than nominal, share of the oracle."""

    spearman: float
    regressions: int
    share: float


def noise_pairs(usual: Sequence[Outcome], weaker: Sequence[Outcome]) -> list[NoisePair]:
    """Return the grids that were measured under both."""
    before = {_grid(one): one for one in usual}
    return [NoisePair(before[_grid(one)], one) for one in weaker if _grid(one) in before]


def worth_finding(pairs: Sequence[NoisePair]) -> list[NoisePair]:
    """Return the pairs on whose usual grid the oracle gains enough."""
    return [pair for pair in pairs if pair.usual.change(pair.usual.oracle) < -WORTH_FINDING]


def standings(pairs: Sequence[NoisePair]) -> tuple[Standing, Standing]:
    """Return what the usual and the weaker noise are worth; the shares are over the pairs worth finding."""
    worth = worth_finding(pairs)
    usual = _standing([pair.usual for pair in pairs], [one.usual for one in worth])
    return usual, _standing([pair.weaker for pair in pairs], [one.weaker for one in worth])


def noise_sentence(pairs: Sequence[NoisePair]) -> str:
    """Return what the comparison says, in a sentence; empty where there is none."""
    if not pairs:
        return ""
    usual, weaker = standings(pairs)
    return (
        f"{len(pairs)} grids were repeated with weaker noise (see below): where the oracle's gain is worth finding "
        f"({len(worth_finding(pairs))} grids) picks reach {share(weaker.share)} of it instead of {share(usual.share)}, "
        f"{weaker.regressions} instead of {usual.regressions} picks are worse than nominal by more than "
        f"{_REGRESSION:.0%}, and Spearman's correlation of score and true ATE is {plain(weaker.spearman)} instead of "
        f"{plain(usual.spearman)} on average."
    )


def noise_table(pairs: Sequence[NoisePair]) -> Table:
    """Return a row for each grid, after the averages."""
    columns = ["experiment", "usual noise", "weaker noise", "Spearman, usual", "weaker"]
    columns += ["pick, usual", "weaker", "oracle", "confirmation, usual", "weaker"]
    if not pairs:
        return columns, []
    usual, weaker = standings(pairs)
    all_of = f"{len(pairs)} grids: Spearman on average, regressions"
    wrong = [f"{one.regressions} of {len(pairs)} worse" for one in (usual, weaker)]
    rows = [[all_of, "", "", plain(usual.spearman), plain(weaker.spearman), *wrong, "", "", ""]]
    worth = f"share of the oracle, {len(worth_finding(pairs))} grids"
    rows.append([worth, "", "", "", "", share(usual.share), share(weaker.share), share(1.0), "", ""])
    for one in sorted(pairs, key=lambda pair: pair.usual.change(pair.usual.oracle)):
        both = [_agreement(outcome) for outcome in one]
        picked = [percent(outcome.change(found.pick)) for outcome, found in zip(one, both, strict=True)]
        rows.append(
            [
                f"{one.usual.experiment.sequence} {one.usual.experiment.option.short}",
                *(f"{outcome.experiment.sigma:g}" for outcome in one),
                *(plain(found.spearman) for found in both),
                *picked,
                percent(one.usual.change(one.usual.oracle)),
                *map(_verdict, one),
            ]
        )
    return columns, rows


def _standing(outcomes: Sequence[Outcome], worth: Sequence[Outcome]) -> Standing:
    found = [(one, _agreement(one)) for one in outcomes]
    worse = sum(outcome.change(agreement.pick) > _REGRESSION for outcome, agreement in found)
    return Standing(mean(agreement.spearman for _, agreement in found), worse, share_of_oracle(worth)[0])


def _verdict(outcome: Outcome) -> str:
    if outcome.adopted is None:
        return ""
    return f"adopt {percent(outcome.change(outcome.adopted))}" if outcome.adopted.number else outcome.verdict


def _agreement(outcome: Outcome) -> Agreement:
    return outcome.agreement(PREDICTORS[AGGREGATE])


def _grid(outcome: Outcome) -> tuple[str, str]:
    return outcome.experiment.sequence, outcome.experiment.option.name
