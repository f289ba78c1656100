"""What an interrupted trial has already is said, and what is ahead of a command."""

from pathlib import Path

from gtf_tune.cli.study.notes import runs_of_search
from gtf_tune.execution import InlineExecutor
from gtf_tune.execution.base import RunLimits
from gtf_tune.pipelines.run import RunKind
from gtf_tune.store import studies, trial_queue
from gtf_tune.store.database import Database
from gtf_tune.store.trial_queue import this_worker
from gtf_tune.study.create import checked_definition, create_study
from gtf_tune.study.open_study import open_study
from gtf_tune.study.runs.plan import RunPlanner, SeedSource, kept_runs
from gtf_tune.study.runs.run_source import RunSource
from gtf_tune.study.runs.stop import StopRequest
from tests.study.conftest import Runner, definition_of


def test_runs_of_a_trial_that_was_stopped_are_counted(room: Path, database: Database) -> None:
    create_study(database, checked_definition(definition_of(room), "test"), room)
    study = open_study(database, "small")
    source = RunSource(database, InlineExecutor(), RunLimits(60, 2**30), StopRequest())
    planner = RunPlanner(study.pipeline, study.definition.gtf, SeedSource(0), {})
    (sequence,) = study.sequences.values()
    runs: list[tuple[RunKind, int]] = [("clean", 0), ("clean", 1), ("noisy", 0)]
    source.obtain([planner.request(sequence, {}, run, sigma=5.0, number=0) for run in runs])
    trial_queue.lease_trial(database, study.record.id, study.budget, this_worker())

    kept = kept_runs(database, studies.get(database, "small"))

    assert kept.text == "3 of 5 runs of trial 0 are stored"
    assert runs_of_search(study) == 8 * 5 - 3


def test_a_study_that_is_done_has_nothing_under_way(room: Path, database: Database, run_study: Runner) -> None:
    run_study(definition_of(room, search={"trials": 2}))

    assert kept_runs(database, studies.get(database, "small")).text == ""
    assert runs_of_search(open_study(database, "small")) == 0
