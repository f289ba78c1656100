"""Pipelines that fail, count and use stages on purpose; importable by worker processes."""

import os
import signal
import time
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path

from gtf_tune.errors import RunError
from gtf_tune.pipelines import OptionTable, Pipeline, PipelineJob, PipelineOutput, create_pipeline
from gtf_tune.pipelines.analytic import imaginary_sequence
from gtf_tune.pipelines.run import RunRequest
from gtf_tune.trajectory import Trajectory, from_bytes, to_bytes

SEQUENCE = imaginary_sequence(12)


def request_of(pipeline: Pipeline, index: int = 0, sigma: float = 5.0) -> RunRequest:
    return RunRequest(
        pipeline=pipeline,
        options={},
        sequence=SEQUENCE,
        kind="noisy",
        index=index,
        noise_sigma=sigma,
        noise_seed=100 + index,
        seed=index,
    )


def analytic(**settings: str) -> Pipeline:
    return create_pipeline("analytic", settings)


def failing(failure: str) -> Pipeline:
    return analytic(failure=failure)


@dataclass
class _Double:
    """Behave like the analytic pipeline, with something done first."""

    note: Path
    name: str = "double"
    version: str = "1"
    settings: Mapping[str, str] = field(default_factory=dict)

    @property
    def options(self) -> OptionTable:
        return analytic().options


@dataclass
class KilledFirst(_Double):
    """Die by a signal, as if memory had run out, the first ``times`` times; the note counts the attempts."""

    times: int = 1
    by: int = signal.SIGKILL

    def run(self, job: PipelineJob) -> PipelineOutput:
        with self.note.open("a") as note:
            note.write("x")
        if len(self.note.read_text()) <= self.times:
            os.kill(os.getpid(), self.by)
        return analytic().run(job)


@dataclass
class LosesItsHost(_Double):
    """Kill the process that started this one, the first time."""

    def run(self, job: PipelineJob) -> PipelineOutput:
        with self.note.open("a") as note:
            note.write("x")
        if len(self.note.read_text()) <= 1:
            os.kill(os.getppid(), signal.SIGKILL)
            signal.pause()
        return analytic().run(job)


@dataclass
class Hanging(_Double):
    """Write down the process and never end."""

    def run(self, job: PipelineJob) -> PipelineOutput:
        del job
        self.note.write_text(str(os.getpid()))
        while True:
            signal.pause()


@dataclass
class Listening(_Double):
    """Write down whether a program that the run starts would ignore Ctrl-C, and whether it would be withheld."""

    def run(self, job: PipelineJob) -> PipelineOutput:
        ignored = signal.getsignal(signal.SIGINT) is signal.SIG_IGN
        withheld = signal.SIGINT in signal.pthread_sigmask(signal.SIG_BLOCK, [])
        self.note.write_text(f"{ignored=} {withheld=}")
        return analytic().run(job)


@dataclass
class Staged(_Double):
    """Go through two stages, as real pipelines do; the note counts what was built."""

    def run(self, job: PipelineJob) -> PipelineOutput:
        def build_first(folder: Path) -> None:
            self._built("first")
            (folder / "pixels.bin").write_bytes(job.images.key.encode() * 100)

        first = job.stages.reach("first", job.images.key, build_first)

        def build_second(folder: Path) -> None:
            self._built("second")
            assert (first / "pixels.bin").read_bytes() == job.images.key.encode() * 100
            (folder / "found.traj").write_bytes(to_bytes(analytic().run(job).trajectory))

        key = f"{job.images.key[:-1]}{job.seed % 10}"
        second = job.stages.reach("second", key, build_second)
        found: Trajectory = from_bytes((second / "found.traj").read_bytes())
        return PipelineOutput(found)

    def _built(self, stage: str) -> None:
        with self.note.open("a") as note:
            note.write(f"{stage}\n")


@dataclass
class Slow(_Double):
    """Take a while for a stage that all runs share, and a while for the run itself."""

    stage_s: float = 0.0
    run_s: float = 0.0

    def run(self, job: PipelineJob) -> PipelineOutput:
        job.stages.reach("slow", "ab" * 32, lambda folder: time.sleep(self.stage_s))
        self.note.write_text("begun")
        time.sleep(self.run_s)
        return analytic().run(job)


@dataclass
class Refusing(_Double):
    """Refuse every run but the first, or all of them where the note exists; the note beside it counts the runs."""

    pause_s: float = 0.0

    def run(self, job: PipelineJob) -> PipelineOutput:
        with self.note.with_suffix(".runs").open("a") as runs:
            runs.write(f"{job.seed}\n")
        time.sleep(self.pause_s)
        if job.seed or self.note.exists():
            raise RunError("it refuses")
        return analytic().run(job)


@dataclass
class FillsItsDisk(_Double):
    """Write a large file, and where the disk has no room for it fail in one of the ways in which programs do."""

    how: str = "words"
    size: int = 2**30

    def run(self, job: PipelineJob) -> PipelineOutput:
        large = job.workspace / "large"
        try:
            with large.open("wb") as file:
                for _ in range(self.size // 2**16):
                    file.write(b"x" * 2**16)
        except OSError:
            large.unlink()
            if self.how == "abort":
                os.abort()
            raise (RunError if self.how == "words" else RuntimeError)("No registered database factory") from None
        return analytic().run(job)
