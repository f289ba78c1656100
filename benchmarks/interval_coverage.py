"""Simulate how trustworthy intervals, tests and collapse marks of the score are.

Run ``python benchmarks/interval_coverage.py [--rounds N] [--json FILE]``; it prints the same numbers each time.

Errors are lognormal with random clean runs, noise instances and their interaction: log e_ij = clean_i + noise_j +
rest_ij, with standard deviations as found in GLOMAP studies: instances differ by a third, clean runs of one setting
hardly; 15 % stand for a less reproducible pipeline. A collapsed run is 100 times worse.
"""

import argparse
import json
import math
from collections.abc import Iterator
from dataclasses import dataclass
from itertools import product
from pathlib import Path
from typing import get_args

import numpy as np
from scipy import stats

from gtf_tune.gtf import Aggregate, GtfScore, aggregate_matrix, estimate, find_collapsed, paired_difference
from gtf_tune.trajectory import FloatArray

CLEAN_RUNS = 2
NOISY_RUNS = (4, 6, 8, 12)
INSTANCE_SPREAD = 0.33
COMMON_SPREAD = 0.25
REST_SPREAD = 0.1
COLLAPSE_FACTOR = 100.0
LEVEL = 0.05
EFFECT = -0.3
GRID = 100_000
Record = dict[str, float | int | str]


@dataclass(frozen=True)
class World:
    """What errors are drawn from: spread of clean runs, share of collapsed noisy runs."""

    clean_spread: float
    collapse: float

    def errors(self, generator: np.random.Generator, instances: FloatArray) -> FloatArray:
        """Return a (2, k_delta) matrix of errors under the effects (k_delta,) of noise instances."""
        shape = (CLEAN_RUNS, len(instances))
        clean = self.clean_spread * generator.normal(size=(CLEAN_RUNS, 1))
        broken = generator.random(size=shape[1]) < self.collapse
        logarithms = clean + instances + REST_SPREAD * generator.normal(size=shape)
        matrix: FloatArray = np.exp(logarithms) * np.where(broken, COLLAPSE_FACTOR, 1.0)
        return matrix

    def truth(self, aggregate: Aggregate) -> float:
        """Return the aggregate of infinitely many independent pairs."""
        spread = math.hypot(self.clean_spread, INSTANCE_SPREAD, REST_SPREAD)
        parts = [(round(GRID * (1 - self.collapse)), 1.0), (round(GRID * self.collapse), COLLAPSE_FACTOR)]
        values = [size * np.exp(spread * stats.norm.ppf((np.arange(count) + 0.5) / count)) for count, size in parts]
        return aggregate_matrix(np.concatenate(values)[np.newaxis], aggregate)


WORLDS = [World(clean, collapse) for clean, collapse in product((0.02, 0.15), (0.0, 0.05, 0.17))]


def coverage(rounds: int) -> Iterator[Record]:
    """Yield how often the 95 % interval of each aggregate holds the truth, and how wide it is."""
    for world, aggregate in product(WORLDS, get_args(Aggregate)):
        record: Record = {"clean_spread": world.clean_spread, "collapse": world.collapse, "aggregate": aggregate}
        for noisy_runs in NOISY_RUNS:
            generator = np.random.default_rng([noisy_runs, round(1000 * world.clean_spread)])
            instances = INSTANCE_SPREAD * generator.normal(size=(rounds, noisy_runs))
            found = [estimate(world.errors(generator, instance), aggregate, generator) for instance in instances]
            truth = world.truth(aggregate)
            record[f"kd={noisy_runs}"] = float(np.mean([one.low <= truth <= one.high for one in found]))
            record[f"width {noisy_runs}"] = float(np.median([one.high / one.low for one in found]))
        yield record


def verdicts(rounds: int) -> Iterator[Record]:
    """Yield how often each test calls two settings different, where they are equal and where one is 26 % better."""
    for world, effect in product(WORLDS, (0.0, EFFECT)):
        for noisy_runs in NOISY_RUNS:
            generator = np.random.default_rng([noisy_runs, round(1000 * world.clean_spread)])
            p_values = [_p_values(*_two_settings(world, generator, noisy_runs, effect)) for _ in range(rounds)]
            shares = (np.array(p_values) < LEVEL).mean(axis=0).tolist()
            record: Record = {"clean_spread": world.clean_spread, "collapse": world.collapse}
            record |= {"effect": effect, "kd": noisy_runs}
            yield record | dict(zip(("paired_difference", "t test", "Wilcoxon"), shares, strict=True))


def marks(rounds: int) -> Iterator[Record]:
    """Yield the share of healthy runs marked as collapsed, and of runs 10 and 100 times worse that are marked."""
    for spread, noisy_runs in product((INSTANCE_SPREAD, 0.5, 0.7, 1.0), (3, *NOISY_RUNS)):
        generator = np.random.default_rng([noisy_runs, round(100 * spread)])
        healthy = np.exp(
            spread * generator.normal(size=(rounds, 1, noisy_runs))
            + REST_SPREAD * generator.normal(size=(rounds, CLEAN_RUNS, noisy_runs))
        )
        record: Record = {"spread": spread, "kd": noisy_runs}
        record["false alarms"] = float(np.mean([find_collapsed(matrix) for matrix in healthy]))
        for factor in (10, 100):
            healthy[:, :, 0] *= 10
            record[f"found at {factor} x"] = float(np.mean([find_collapsed(matrix)[0] for matrix in healthy]))
        yield record


def _two_settings(
    world: World, generator: np.random.Generator, noisy_runs: int, effect: float
) -> tuple[FloatArray, FloatArray]:
    common = COMMON_SPREAD * generator.normal(size=noisy_runs)
    own = math.sqrt(INSTANCE_SPREAD**2 - COMMON_SPREAD**2)
    first, second = (
        world.errors(generator, common + shift + own * generator.normal(size=noisy_runs)) for shift in (0.0, effect)
    )
    return first, second


def _p_values(a: FloatArray, b: FloatArray) -> tuple[float, float, float]:
    gaps = (np.log(b) - np.log(a)).mean(axis=0)
    return (
        paired_difference(score_of(a), score_of(b)).p_value,
        float(stats.ttest_1samp(gaps, 0).pvalue),
        float(stats.wilcoxon(gaps).pvalue),
    )


def score_of(matrix: FloatArray) -> GtfScore:
    """Return the score that a matrix of simulated errors stands for, of runs that registered every frame."""
    ones = np.ones(matrix.shape)
    return GtfScore(
        value=float(matrix.mean()),
        standard_error=math.nan,
        confidence_interval=(math.nan, math.nan),
        matrix=matrix,
        pair_errors={},
        coverage_clean=ones[:, 0],
        coverage_noisy=ones[0],
        extents=ones,
        matched=ones.astype(np.int64),
        num_frames=1,
        collapsed=find_collapsed(matrix),
    )


def _print(title: str, records: list[Record]) -> None:
    print(f"\n{title}")
    print("  ".join(f"{name:>12}" for name in records[0]))
    for record in records:
        print("  ".join(f"{value:12.3f}" if isinstance(value, float) else f"{value:>12}" for value in record.values()))


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--rounds", type=int, default=500, metavar="N", help="simulations a cell (default: 500)")
    parser.add_argument("--json", type=Path, metavar="FILE", help="write the tables here too")
    arguments = parser.parse_args()
    tables = {
        "Coverage of the 95 % interval, and median high / low": list(coverage(arguments.rounds)),
        "Share of verdicts 'different' at 5 %": list(verdicts(arguments.rounds)),
        "Marks of collapsed runs": list(marks(arguments.rounds)),
    }
    for title, records in tables.items():
        _print(title, records)
    if arguments.json:
        arguments.json.write_text(json.dumps(tables, indent=2) + "\n", encoding="utf-8")


if __name__ == "__main__":
    main()
