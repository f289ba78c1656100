"""Hold all that the experiments measured."""

from collections.abc import Sequence
from dataclasses import dataclass

from benchmarks.experiments.joint import Joint
from benchmarks.experiments.k_delta import Curve
from benchmarks.experiments.ladder import Ladder
from benchmarks.experiments.numbers import mean
from benchmarks.experiments.plan import AGGREGATE
from benchmarks.experiments.settings import PREDICTORS, Outcome
from benchmarks.experiments.several import Candidate

WORTH_FINDING = 0.03
"""Oracle's gain from which on a pick is asked to reach most of it."""

AIM = 0.9


@dataclass(frozen=True)
class Findings:
    """Hold the grids of table 2, with many noisy runs, with weaker noise, over options that drop frames and of the
    ablation; joint searches; noise ladders; what is missing; curves over the number of noisy runs; and the candidates
    of the search over several sequences.
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


def share_of_oracle(outcomes: Sequence[Outcome], predictor: str = AGGREGATE) -> tuple[float, int]:
    """Return the part of the possible gain that picks reach on average, and over how many grids.

    Only grids count whose oracle gains more than 3 %; a loss counts as -100 % at the most.
    """
    chosen = PREDICTORS[predictor]
    worth = [one for one in outcomes if one.change(one.oracle) < -WORTH_FINDING and one.knows(chosen)]
    shares = [max(one.change(one.agreement(chosen).pick) / one.change(one.oracle), -1.0) for one in worth]
    return mean(shares), len(worth)
