"""All that the experiments measured."""

from collections.abc import Sequence
from dataclasses import dataclass

from experiments.fresh import FreshError
from experiments.joint import Joint
from experiments.k_delta import Curve
from experiments.ladder import Ladder
from experiments.numbers import mean
from experiments.plan import AGGREGATE
from experiments.settings import PREDICTORS, Outcome, Setting
from experiments.several import Candidate

WORTH_FINDING = 0.03
"""Oracle's gain from which on a pick is asked to reach most of it."""

AIM = 0.9


@dataclass(frozen=True)
class Findings:
    """The grids of table 2, with many noisy runs, with weaker noise, over options that drop frames and of the
    ablation; joint searches; noise ladders; what is missing; curves over the number of noisy runs; the candidates of
    the search over several sequences; and those of the confirmations, judged on the confirmations' own noise.
    """

    outcomes: Sequence[Outcome]
    many: Sequence[Outcome]
    weaker: Sequence[Outcome]
    traps: Sequence[Outcome]
    ablated: Sequence[Outcome]
    joints: Sequence[Joint]
    ladders: Sequence[Ladder]
    missing: Sequence[str]
    curves: Sequence[Curve] = ()
    several: Sequence[Candidate] = ()
    fresh: Sequence[FreshError] = ()


def share_of_oracle(outcomes: Sequence[Outcome], predictor: str = AGGREGATE) -> tuple[float, int]:
    """Return the part of the possible gain that picks reach on average, and over how many grids.

    Only grids count whose oracle gains more than 3 %; a loss counts as -100 % at the most.
    """
    chosen = PREDICTORS[predictor]
    worth = [
        outcome for outcome in outcomes if outcome.change(outcome.oracle) < -WORTH_FINDING and outcome.knows(chosen)
    ]
    return _mean_share(worth, [one.agreement(chosen).pick for one in worth]), len(worth)


def share_of_verdicts(outcomes: Sequence[Outcome]) -> tuple[float, int]:
    """Return the same for what confirmations adopted, nominal where they kept it, over confirmed grids."""
    worth = [outcome for outcome in outcomes if outcome.change(outcome.oracle) < -WORTH_FINDING]
    found = [(one, one.adopted) for one in worth if one.adopted is not None]
    return _mean_share([one for one, _ in found], [adopted for _, adopted in found]), len(found)


def _mean_share(outcomes: Sequence[Outcome], taken: Sequence[Setting]) -> float:
    shares = [
        max(one.change(setting) / one.change(one.oracle), -1.0) for one, setting in zip(outcomes, taken, strict=True)
    ]
    return mean(shares)
