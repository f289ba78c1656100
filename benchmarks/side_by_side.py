"""Compare one job with two on the same study."""

import tempfile
import time
from pathlib import Path

from benchmarks.images import FIXED_OPTIONS, in_words, room
from benchmarks.section import Aim, Effort, Section, median
from gtf_tune.definition import GtfDefinition
from gtf_tune.execution import LocalExecutor, RunLimits, StageCache
from gtf_tune.pipelines import create_pipeline
from gtf_tune.pipelines.run import RunRequest
from gtf_tune.sequence import Sequence
from gtf_tune.study.runs.plan import RunPlanner, SeedSource, run_order
from gtf_tune.trajectory import to_bytes

LIMITS = RunLimits(timeout_s=900.0, memory_bytes=8 * 2**30)
AIM = 1.8


def run(effort: Effort) -> Section:
    rounds = effort.pick(2, 5)
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        sequence = room(folder)
        cache = StageCache(folder / "cache")
        seconds: dict[int, list[float]] = {1: [], 2: []}
        results: set[bytes] = set()
        with (
            LocalExecutor(jobs=1, stages=cache, scratch=folder / "one") as one,
            LocalExecutor(jobs=2, stages=cache, scratch=folder / "two") as two,
        ):
            for executor in (one, two):  # fills the cache and lets the processes import the pipeline
                _time(executor, _requests(sequence, 0.011))
            for number in range(rounds):
                for jobs, executor in ((1, one), (2, two)):
                    taken, bits = _time(executor, _requests(sequence, 0.01 + 1e-4 * number))
                    seconds[jobs].append(taken)
                    results.add(bits) if number == 0 else None
    gains = [first / second for first, second in zip(seconds[1], seconds[2], strict=True)]
    return Section(
        title="One job against two",
        text=(
            f"The eight runs of a BA-threshold trial of GLOMAP on {in_words(sequence)}, image stages cached, with one "
            f"job and with two in turn, {rounds} rounds."
        ),
        header=("jobs", "a trial, median", "gain, median", "results"),
        rows=(
            ("1", f"{median(seconds[1]):.2f} s", "1.00 x", ""),
            (
                "2",
                f"{median(seconds[2]):.2f} s",
                f"{median(gains):.2f} x",
                "same bits" if len(results) == 1 else "DIFFERENT",
            ),
        ),
        aims=(
            Aim(
                wanted=f"two jobs on two cores at least {AIM:g} x one",
                measured=f"{median(gains):.2f} x",
                met=median(gains) >= AIM,
                bound="" if median(gains) >= AIM else "Both cores share caches, memory and whatever else runs here.",
            ),
        ),
    )


def _requests(sequence: Sequence, threshold: float) -> list[RunRequest]:
    planner = RunPlanner(create_pipeline("glomap"), GtfDefinition(), SeedSource(0), FIXED_OPTIONS)
    options = {"mapper.max_normalized_reproj_error": threshold}
    return [planner.request(sequence, options, one, sigma=5.0, number=0) for one in run_order(2, 6)]


def _time(executor: LocalExecutor, requests: list[RunRequest]) -> tuple[float, bytes]:
    began = time.perf_counter()
    outcomes = [future.result() for future in [executor.submit(request, LIMITS) for request in requests]]
    return time.perf_counter() - began, b"".join(to_bytes(outcome.trajectory) for outcome in outcomes)
