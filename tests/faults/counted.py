"""A pipeline that writes down every run it begins; found by its entry point, as those of other packages are."""

import os
import time
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

from gtf_tune.pipelines import OptionTable, OptionValue, PipelineJob, PipelineOutput, create_pipeline
from gtf_tune.pipelines.run import digest

LOG_VARIABLE = "GTF_TUNE_TEST_RUN_LOG"
PAUSE_VARIABLE = "GTF_TUNE_TEST_PAUSE_S"
CLOCK_VARIABLE = "GTF_TUNE_TEST_CLOCK"
"""Names a file with the seconds by which the clock of workers and runs is wrong."""

_true_time = time.time


@dataclass
class CountedPipeline:
    """Behave like the analytic pipeline; ``stages`` lets it go through the images, as real pipelines do."""

    settings: Mapping[str, str]
    name: str = "counted"
    version: str = "1"

    @property
    def options(self) -> OptionTable:
        return create_pipeline("analytic").options

    def run(self, job: PipelineJob) -> PipelineOutput:
        line = identity(job.seed, job.images.seed, job.options) + "\n"
        log = os.open(os.environ[LOG_VARIABLE], os.O_WRONLY | os.O_APPEND | os.O_CREAT)
        os.write(log, line.encode())
        os.close(log)
        follow_clock()
        time.sleep(float(os.environ[PAUSE_VARIABLE]))
        if self.settings["stages"] == "yes":
            job.stages.reach("images", job.images.key, job.images.write)
        return create_pipeline("analytic").run(job)


def follow_clock() -> None:
    """Let `time.time` of this process be wrong by what the file of `CLOCK_VARIABLE` says, where there is one."""
    clock = Path(os.environ.get(CLOCK_VARIABLE, ""))

    def wrong_time() -> float:
        return _true_time() + float(clock.read_text() if clock.is_file() else 0.0)

    time.time = wrong_time


def identity(seed: int, noise_seed: int, options: Mapping[str, OptionValue]) -> str:
    """Return what tells the runs of one sequence apart, from a job or from a stored run."""
    return digest([seed, noise_seed, dict(options)])


def create(settings: Mapping[str, object]) -> CountedPipeline:
    """Return the pipeline."""
    return CountedPipeline({"stages": str(settings.get("stages", "no"))})


def install(site: Path) -> None:
    """Write what pip would write, so that the pipeline is found by whoever has ``site`` on its path."""
    folder = site / "gtf_tune_counted-1.dist-info"
    folder.mkdir(parents=True)
    (folder / "METADATA").write_text("Metadata-Version: 2.1\nName: gtf-tune-counted\nVersion: 1\n")
    (folder / "entry_points.txt").write_text("[gtf_tune.pipelines]\ncounted = tests.faults.counted:create\n")
