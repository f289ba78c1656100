"""Pipelines that misbehave: each ends as a failed run with a reason, and leaves nobody running."""

import os
import signal
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
import psutil
import pytest

from gtf_tune.execution import LocalExecutor, RunLimits
from gtf_tune.pipelines import OptionTable, PipelineJob, PipelineOutput, create_pipeline
from gtf_tune.pipelines.analytic import imaginary_sequence
from gtf_tune.pipelines.run import RunOutcome, RunRequest
from gtf_tune.trajectory import Trajectory, read_trajectory
from tests.faults.disturbance import is_running, wait_until

LIMITS = RunLimits(timeout_s=1.0, memory_bytes=2**30)


@dataclass(frozen=True)
class Misbehaving:
    """Do what ``conduct`` does with a job, and give what it gives."""

    conduct: Callable[[PipelineJob], Trajectory]
    note: Path = field(default_factory=Path)
    name: str = "misbehaving"
    version: str = "1"
    settings: Mapping[str, str] = field(default_factory=dict)

    @property
    def options(self) -> OptionTable:
        return create_pipeline("analytic").options

    def run(self, job: PipelineJob) -> PipelineOutput:
        os.environ["GTF_TUNE_TEST_NOTE"] = str(self.note)
        return PipelineOutput(self.conduct(job))


def poses(**changes: object) -> Trajectory:
    values: dict[str, object] = {
        "frame_ids": np.arange(3),
        "timestamps": np.arange(3) / 30,
        "positions": np.eye(3),
        "quaternions": np.tile([0.0, 0.0, 0.0, 1.0], (3, 1)),
    }
    return Trajectory(**{**values, **changes})  # type: ignore[arg-type]


def nothing(job: PipelineJob) -> Trajectory:
    return Trajectory.empty()


def nan(job: PipelineJob) -> Trajectory:
    return poses(positions=np.full((3, 3), np.nan))


def unsorted(job: PipelineJob) -> Trajectory:
    return poses(frame_ids=np.array([2, 0, 1]))


def truncated(job: PipelineJob) -> Trajectory:
    path = job.workspace / "poses.txt"
    path.write_text("0.0 1 2 3 0 0 0 1\n0.1 1 2")
    return read_trajectory(path, format="tum")


def empty_file(job: PipelineJob) -> Trajectory:
    path = job.workspace / "poses.txt"
    path.touch()
    return read_trajectory(path, format="tum")


def forks_and_hangs(job: PipelineJob) -> Trajectory:
    for _ in range(3):
        if not os.fork():
            with Path(os.environ["GTF_TUNE_TEST_NOTE"]).open("a") as note:
                note.write(f"{os.getpid()}\n")
            while True:
                signal.pause()
    while True:
        signal.pause()


@pytest.fixture(scope="module")
def executor(tmp_path_factory: pytest.TempPathFactory) -> Iterator[LocalExecutor]:
    with LocalExecutor(1, scratch=tmp_path_factory.mktemp("scratch")) as executor:
        yield executor


def outcome_of(executor: LocalExecutor, pipeline: Misbehaving) -> RunOutcome:
    request = RunRequest(pipeline, {}, imaginary_sequence(12), "clean", 0, 0.0, 0, seed=1)
    return executor.submit(request, LIMITS).result(timeout=120)


@pytest.mark.parametrize(
    ("conduct", "reason"),
    [
        (nothing, "a trajectory without poses"),
        (nan, "expected finite positions"),
        (unsorted, "increas"),
        (truncated, "poses.txt"),
        (empty_file, "poses.txt"),
    ],
)
def test_a_trajectory_that_cannot_be_true_is_a_failed_run(
    executor: LocalExecutor, conduct: Callable[[PipelineJob], Trajectory], reason: str
) -> None:
    outcome = outcome_of(executor, Misbehaving(conduct))

    assert outcome.status == "failed"
    assert reason in outcome.error
    assert "\n" not in outcome.error


def test_children_that_a_hanging_pipeline_forked_end_with_it(executor: LocalExecutor, tmp_path: Path) -> None:
    note = tmp_path / "pids"

    outcome = outcome_of(executor, Misbehaving(forks_and_hangs, note))

    assert "no result within 1 s" in outcome.error
    pids = [int(line) for line in note.read_text().split()]
    assert len(pids) == 6  # a hang is tried once more, with three processes each time
    wait_until(lambda: not any(psutil.pid_exists(pid) and is_running(psutil.Process(pid)) for pid in pids))
