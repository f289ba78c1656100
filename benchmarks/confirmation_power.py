"""Simulate how often a confirmation adopts: a configuration that is equal to nominal, and ones that are better.

`python -m benchmarks.simulations --only power` runs it, and gives the same numbers each time; beside them is the mean
number of noisy runs at which the looks end a confirmation. It is the reason for the default number of noisy runs and
for the looks.

Errors are lognormal: noise instances differ by a third, three quarters of that (in logarithms) the same under both
settings, and every pair varies by 10 %. "paired tightly" is what bare thresholds of GLOMAP's bundle adjustment show on
well-textured sequences: nine tenths in common. A collapsed run is 100 times worse; both settings collapse equally
often.
"""

import math
from collections.abc import Iterator
from dataclasses import dataclass
from itertools import product

import numpy as np

from benchmarks.interval_coverage import score_of
from gtf_tune.definition import GtfDefinition
from gtf_tune.gtf import GtfScore
from gtf_tune.study.outcome.confirm import looks_at
from gtf_tune.study.outcome.judge import Findings, Measured, judge
from gtf_tune.study.outcome.verdict import ADOPT
from gtf_tune.trajectory import FloatArray

CLEAN_RUNS = 2
NOISY_RUNS = (8, 16, 24)
EFFECTS = (0.0, 0.10, 0.20, 0.30)
CANDIDATES = (1, 3)
TYPICAL_ERROR = 0.003
"""Median error over the extent; much larger ones make the confirmation doubt the score, whatever it compares."""

INSTANCE_SPREAD = 0.33
REST_SPREAD = 0.1
COLLAPSE_FACTOR = 100.0
Record = dict[str, float | int | str]


@dataclass(frozen=True)
class World:
    """How much of the instances' spread is common to settings, and the share of collapsed noisy runs."""

    name: str
    common: float
    collapse: float

    def setting(self, generator: np.random.Generator, instances: FloatArray, effect: float) -> GtfScore:
        """Return the score of a setting whose errors are smaller by ``effect``."""
        count = len(instances)
        own = INSTANCE_SPREAD * math.sqrt(1 - self.common**2) * generator.normal(size=count)
        rest = REST_SPREAD * generator.normal(size=(CLEAN_RUNS, count))
        shared = INSTANCE_SPREAD * self.common * instances
        broken = np.where(generator.random(size=count) < self.collapse, COLLAPSE_FACTOR, 1.0)
        return score_of(TYPICAL_ERROR * (1 - effect) * np.exp(shared + own + rest) * broken)


WORLDS = (
    World("as found", 0.75, 0.0),
    World("as found, 5 % collapse", 0.75, 0.05),
    World("paired tightly", 0.9, 0.0),
)


CELLS = {(world.name, candidates, effect): world for world, candidates, effect in product(WORLDS, CANDIDATES, EFFECTS)}
"""The worlds by the names, numbers of candidates and effects that are simulated."""


def adoptions(rounds: int, known: frozenset[tuple[object, ...]] = frozenset()) -> Iterator[Record]:
    """Yield how often a confirmation adopts any candidate, and after how many runs; all have the same effect.

    False adoptions are rare, so equal configurations take four times as many rounds. Cells that are ``known`` are left
    out.
    """
    for cell, world in CELLS.items():
        if cell in known:
            continue
        name, candidates, effect = cell
        count = rounds if effect else 4 * rounds
        record: Record = {"world": name, "candidates": candidates, "effect": effect, "rounds": count}
        for noisy_runs in NOISY_RUNS:
            generator = np.random.default_rng([noisy_runs, candidates, round(100 * world.common)])
            ends = [_end(world, generator, noisy_runs, [effect] * candidates) for _ in range(count)]
            record[f"N={noisy_runs}"] = float(np.mean([verdict == ADOPT for verdict, _ in ends]))
            record[f"runs of {noisy_runs}"] = float(np.mean([runs for _, runs in ends]))
        yield record


def standard_error(share: float, rounds: int) -> float:
    """Return the standard error of a simulated share; of none among n it is taken for one half among n."""
    least = 0.5 / rounds
    kept = min(max(share, least), 1 - least)
    return math.sqrt(kept * (1 - kept) / rounds)


def _end(world: World, generator: np.random.Generator, noisy_runs: int, effects: list[float]) -> tuple[str, int]:
    """Return the verdict of one confirmation and the noisy runs of nominal by then."""
    instances = generator.normal(size=noisy_runs)
    configurations = [world.setting(generator, instances, effect) for effect in [0.0, *effects]]
    ended: dict[int, int] = {}
    for look in looks_at(noisy_runs):
        seen = [
            Measured(number, {}, {"sequence": score_of(score.matrix[:, : ended.get(number, look.noisy_runs)])})
            for number, score in enumerate(configurations)
        ]
        verdict = judge(Findings(seen[0], tuple(seen[1:])), GtfDefinition(), look.significance)
        dropped = {one.number for one in verdict.candidates if one.improvement.value <= 0}
        ended |= {number: look.noisy_runs for number in dropped - set(ended)}
        if verdict.word == ADOPT or len(ended) == len(effects):
            break
    return verdict.word, look.noisy_runs
