"""Measure the score over a ladder of noise levels (the paper's figures on linearity and noise magnitude)."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from experiments.measure import Bench, local_executor
from experiments.numbers import known
from experiments.plan import FIXED, FRAMES, ROOM
from gtf_tune.definition import GtfDefinition, LimitsDefinition
from gtf_tune.metrics import ate
from gtf_tune.pipelines import create_pipeline
from gtf_tune.pipelines.run import RunRequest
from gtf_tune.sequence import Selection, load_sequence
from gtf_tune.sequence import Sequence as ImageSequence
from gtf_tune.store import runs
from gtf_tune.store.database import Database
from gtf_tune.store.runs import trajectories
from gtf_tune.study.noise.choice import ObtainRuns, stored_runs
from gtf_tune.study.noise.ladder import NoiseProbe, NoiseScale
from gtf_tune.study.runs.run_source import RunSource, SequenceRuns, run_limits, sequence_runs
from gtf_tune.trajectory import Trajectory

SEQUENCES = (ROOM, "dtu-scan24", "fountain-P11", "hut", "kitti07", "kitti06")
SIGMAS = (0.5, 1.0, 2.0, 5.0, 8.0)
RUNS = 4


class NotMeasuredError(Exception):
    """Signal that a ladder is not complete in the database."""


@dataclass(frozen=True)
class Rung:
    """One level: score and spread as in `NoiseLevel`, and the mean true ATE of its noisy runs."""

    sigma: float
    score: float
    spread: float | None
    collapsed: int
    linear: bool | None
    true_ate: float | None


@dataclass(frozen=True)
class Ladder:
    """A ladder; ``floor`` is the score of clean runs against clean runs."""

    sequence: str
    floor: float
    rungs: tuple[Rung, ...]
    recommended: float


def ladder_of(sequence: str, scale: NoiseScale, true_ates: Sequence[float]) -> Ladder:
    """Return the ladder that a noise scale and the true errors of its levels make."""
    rungs = tuple(
        Rung(level.sigma, level.score, known(level.spread), level.collapsed, inside, known(true_ate))
        for level, inside, true_ate in zip(scale.levels, scale.linear, true_ates, strict=True)
    )
    return Ladder(sequence, scale.floor.score, rungs, scale.recommended)


def run_ladder(bench: Bench, name: str) -> None:
    """Measure the ladder of a sequence; finished runs are kept."""
    with local_executor(bench.jobs) as executor:
        source = RunSource(bench.database, executor, run_limits(LimitsDefinition()), bench.stop)
        _probe().measure(_frames_of(name, bench.folders), stored_runs(source))


def read_ladder(database: Database, folders: Mapping[str, Path], name: str) -> Ladder:
    """Return a finished ladder.

    Raises
    ------
    NotMeasuredError
        Some of its runs are missing.
    """
    sequence = _frames_of(name, folders)
    seen: list[list[Trajectory]] = []
    scale = _probe().measure(sequence, only_stored(database, seen))
    # The first group holds the clean runs; each further one is a level.
    return ladder_of(name, scale, [_mean_ate(sequence, level) for level in seen[1:]])


def _frames_of(name: str, folders: Mapping[str, Path]) -> ImageSequence:
    return load_sequence(folders[name], name=name, selection=Selection(**FRAMES.get(name, {})))


def _probe() -> NoiseProbe:
    return NoiseProbe(create_pipeline("glomap"), dict(FIXED), GtfDefinition(), runs=RUNS, ladder=SIGMAS)


def only_stored(database: Database, seen: list[list[Trajectory]]) -> ObtainRuns:
    """Return a way to obtain stored runs only, which appends the trajectories of each call to ``seen``."""

    def obtain(requests: Sequence[RunRequest]) -> SequenceRuns:
        keys = [request.key for request in requests]
        stored = runs.find(database, keys)
        if len(stored) < len(keys):
            raise NotMeasuredError
        found = trajectories(database, keys)
        seen.append([found[key] for key in keys])
        made = ((request.kind, found[key], stored[key].error) for request, key in zip(requests, keys, strict=True))
        return sequence_runs(made, len(requests[0].sequence))

    return obtain


def _mean_ate(sequence: ImageSequence, level: list[Trajectory]) -> float:
    if sequence.ground_truth is None:
        return float("nan")
    return float(np.mean([ate(sequence.ground_truth, one, alignment="sim3") for one in level if len(one)]))
