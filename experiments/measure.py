"""Run what is planned and not stored yet; every finished run is kept, so that work goes on where it stopped."""

import os
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from experiments.plan import ROOM, TOP, Experiment
from gtf_tune.execution import LocalExecutor, StageCache, default_cache_folder
from gtf_tune.sequence import load_sequence
from gtf_tune.sequence.render.room import RoomSpec, render_room
from gtf_tune.store import confirmations, studies
from gtf_tune.store.database import Database
from gtf_tune.study.create import checked_definition, create_study
from gtf_tune.study.open_study import open_study
from gtf_tune.study.outcome.confirm import confirm, plan_confirmation
from gtf_tune.study.runs.run_source import Interrupted, RunSource, run_limits
from gtf_tune.study.runs.stop import StopRequest
from gtf_tune.study.work.worker import StudyWorker
from gtf_tune.trajectory import Trajectory

DATA_VARIABLE = "GTF_TUNE_DATA"
ROOM_FOLDER = Path("storage/data/experiments-room")
ROOM_FRAMES = 18


@dataclass(frozen=True)
class Bench:
    """Where results go, where the images are, and how many runs go side by side."""

    database: Database
    folders: Mapping[str, Path]
    stop: StopRequest
    jobs: int = 1


def data_folders() -> dict[str, Path]:
    """Return the folder of each sequence: the rendered room, and those under ``GTF_TUNE_DATA`` with ground truth."""
    if not ROOM_FOLDER.exists():
        render_room(ROOM_FOLDER, RoomSpec(num_frames=ROOM_FRAMES, width=320, height=240))
    found = {ROOM: ROOM_FOLDER.absolute()}
    root = os.environ.get(DATA_VARIABLE)
    if not root:
        print(f"only the rendered room: set {DATA_VARIABLE} to a folder of sequences with groundtruth.txt for more")
        return found
    return found | {path.parent.name: path.parent for path in sorted(Path(root).absolute().glob("*/groundtruth.txt"))}


def ground_truths(folders: Mapping[str, Path]) -> dict[str, Trajectory]:
    """Return the ground truth of the sequences that have one."""
    found = {name: load_sequence(folder).ground_truth for name, folder in folders.items()}
    return {name: one for name, one in found.items() if one is not None}


def local_executor(jobs: int) -> LocalExecutor:
    """Return an executor that shares the stage cache of the command line."""
    folder = default_cache_folder()
    return LocalExecutor(jobs, StageCache(folder), scratch=folder / "scratch")


def run_grid(bench: Bench, experiment: Experiment) -> None:
    """Complete the study of one experiment, or raise `Interrupted`."""
    finish_study(bench, experiment.study, experiment.definition(bench.folders[experiment.sequence]))


def run_confirmation(bench: Bench, experiment: Experiment, noisy_runs: int) -> None:
    """Confirm the best settings of a finished experiment, unless that is done."""
    confirm_study(bench, experiment.study, noisy_runs)


def finish_study(bench: Bench, name: str, definition: Mapping[str, Any]) -> None:
    """Complete a study, created where it is new, or raise `Interrupted`."""
    if name not in studies.names(bench.database):
        create_study(bench.database, checked_definition(definition, name), Path("/"))
    with local_executor(bench.jobs) as executor:
        done = StudyWorker(open_study(bench.database, name), executor, bench.stop).work()
    if not done:
        raise Interrupted


def confirm_study(bench: Bench, name: str, noisy_runs: int) -> None:
    """Confirm the best settings of a finished study, unless that is done."""
    study = open_study(bench.database, name)
    if confirmations.of_study(bench.database, study.record.id):
        return
    plan = plan_confirmation(study, {}, top=TOP, noisy_runs=noisy_runs)
    with local_executor(bench.jobs) as executor:
        limits = run_limits(study.definition.limits)
        confirm(study, plan, RunSource(bench.database, executor, limits, bench.stop))
