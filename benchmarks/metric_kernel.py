"""Measure the batched metric kernel against evo, in one process, interleaved: ratios of medians.

Run ``python benchmarks/metric_kernel.py [--json FILE]``. evo measures one pair at a time, so for many pairs a few of
them are timed and the time is scaled to all.
"""

import argparse
import json
import statistics
import time
from collections.abc import Callable
from dataclasses import asdict, dataclass
from functools import partial
from pathlib import Path

import numpy as np
from evo.core import metrics
from evo.core.trajectory import PoseTrajectory3D
from scipy.spatial.transform import Rotation

from gtf_tune.gtf import GtfSettings, gtf_score
from gtf_tune.metrics import pairwise_matrix
from gtf_tune.trajectory import FloatArray, Trajectory

POSES = 2000
SIZES = ((2, 6), (10, 60))
ROUNDS = 9
EVO_PAIRS = 4
REPEATS = 5
NOISE = 0.05


@dataclass(frozen=True)
class Row:
    """The medians of one size; times are of all its pairs."""

    clean: int
    noisy: int
    poses: int
    evo_s: float
    kernel_s: float
    score_s: float
    largest_relative_difference: float

    @property
    def ratio(self) -> float:
        return self.evo_s / self.kernel_s


def trajectories(count: int, generator: np.random.Generator, scene: FloatArray) -> list[Trajectory]:
    turns = Rotation.from_rotvec(np.linspace(0, 3, POSES)[:, np.newaxis] * [0.1, 1.0, 0.2]).as_quat()
    frames = np.arange(POSES)
    return [
        Trajectory(frames, frames / 30, scene + NOISE * generator.normal(size=scene.shape), turns) for _ in range(count)
    ]


def evo_ate(a: Trajectory, b: Trajectory) -> float:
    first, second = (
        PoseTrajectory3D(one.positions, np.roll(one.quaternions, 1, axis=1), one.timestamps) for one in (a, b)
    )
    second.align(first, correct_scale=True)
    metric = metrics.APE(metrics.PoseRelation.translation_part)
    metric.process_data((first, second))
    return float(metric.get_statistic(metrics.StatisticsType.rmse))


def timed(work: Callable[[], object]) -> float:
    start = time.perf_counter()
    work()
    return time.perf_counter() - start


def measure(clean_runs: int, noisy_runs: int) -> Row:
    generator = np.random.default_rng(0)
    scene = generator.normal(size=(POSES, 3)).cumsum(axis=0)
    clean, noisy = trajectories(clean_runs, generator, scene), trajectories(noisy_runs, generator, scene)
    sample = [(i % clean_runs, (7 * i) % noisy_runs) for i in range(EVO_PAIRS)]
    evo_times: list[float] = []
    kernel_times: list[float] = []
    score_times: list[float] = []
    pairwise_matrix(clean, noisy)
    for _ in range(ROUNDS):
        evo_times += [timed(partial(evo_ate, clean[i], noisy[j])) for i, j in sample]
        kernel_times += [timed(partial(pairwise_matrix, clean, noisy)) for _ in range(REPEATS)]
        score_times += [timed(partial(gtf_score, clean, noisy, GtfSettings(), POSES)) for _ in range(REPEATS)]
    found = pairwise_matrix(clean, noisy).errors
    differences = [abs(found[i, j] / evo_ate(clean[i], noisy[j]) - 1) for i, j in sample]
    return Row(
        clean=clean_runs,
        noisy=noisy_runs,
        poses=POSES,
        evo_s=statistics.median(evo_times) * clean_runs * noisy_runs,
        kernel_s=statistics.median(kernel_times),
        score_s=statistics.median(score_times),
        largest_relative_difference=float(max(differences)),
    )


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--json", type=Path, metavar="FILE", help="write the table here too")
    arguments = parser.parse_args()
    rows = [measure(*size) for size in SIZES]
    print("pairs     evo        kernel     whole score  evo / kernel  largest relative difference")
    for row in rows:
        print(
            f"{row.clean:2d} x {row.noisy:<3d} {row.evo_s * 1e3:8.0f} ms {row.kernel_s * 1e3:8.2f} ms "
            f"{row.score_s * 1e3:8.2f} ms {row.ratio:10.0f} x   {row.largest_relative_difference:.1e}"
        )
    if arguments.json:
        table = [asdict(row) | {"ratio": row.ratio} for row in rows]
        arguments.json.write_text(json.dumps(table, indent=2) + "\n", encoding="utf-8")


if __name__ == "__main__":
    main()
