"""What a worker does when it is killed between two steps, or when its study changes or vanishes under its hands."""

from collections.abc import Callable
from concurrent.futures import Future
from dataclasses import replace
from pathlib import Path
from typing import Any

import optuna
import pytest
from optuna.trial import TrialState

from gtf_tune.errors import DeletedError
from gtf_tune.execution import InlineExecutor, RunLimits
from gtf_tune.pipelines import RunOutcome
from gtf_tune.pipelines.run import RunRequest
from gtf_tune.store import ground_truth_errors, runs, studies, trial_queue, trials
from gtf_tune.store.database import Database, create_database
from gtf_tune.store.maintenance.copy import copy_study
from gtf_tune.store.maintenance.digest import study_digest
from gtf_tune.store.optuna import trials as optuna_trials
from gtf_tune.store.optuna.tables import optuna_storage
from gtf_tune.store.trial_queue import this_worker
from gtf_tune.study.create import checked_definition, create_study
from gtf_tune.study.edit import Extension, extend_study
from gtf_tune.study.events import Event, RunFinished
from gtf_tune.study.open_study import open_study
from gtf_tune.study.runs.stop import FINISH_RUNS, StopRequest
from gtf_tune.study.scoring.rescore import rescore
from gtf_tune.study.work.server import WorkerLoop, WorkerRules
from gtf_tune.study.work.worker import StudyWorker
from tests.study.conftest import Runner, definition_of


class Killed(BaseException):
    """Stand for SIGKILL: nothing between it and the test does anything."""


STEPS = {
    "a trial is created": (optuna_trials, "create_for_number"),
    "its options are noted": (trial_queue, "attach_optuna_trial"),
    "a run is stored": (runs, "save"),
    "its runs are linked": (runs, "link"),
    "the side metric is stored": (ground_truth_errors, "save"),
    "its score is stored": (trial_queue, "finish"),
    "Optuna is told": (optuna_trials, "tell"),
}


def killed(step: Callable[..., Any], number: int, *, before: bool) -> Callable[..., Any]:
    """Return a step at whose call of that number the process dies, before or after the step is done."""
    calls = iter(range(1, 1000))

    def run(*arguments: Any, **named: Any) -> Any:
        mine = next(calls) == number
        if mine and before:
            raise Killed
        result = step(*arguments, **named)
        if mine:
            raise Killed
        return result

    return run


def small(room: Path) -> dict[str, Any]:
    return definition_of(room, gtf={"clean_runs": 1, "noisy_runs": 2}, search={"sampler": "tpe", "trials": 4})


@pytest.mark.parametrize("before", [True, False], ids=["before", "after"])
@pytest.mark.parametrize("step", list(STEPS))
def test_a_worker_killed_between_two_steps_loses_and_repeats_nothing(
    step: str,
    before: bool,
    room: Path,
    tmp_path: Path,
    database: Database,
    run_study: Runner,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    calm = create_database(str(tmp_path / "calm.db"))
    for one in (calm, database):
        create_study(one, checked_definition(small(room), "test"), tmp_path)
    StudyWorker(open_study(calm, "small"), InlineExecutor()).work()
    dead, executor = replace(this_worker(), pid_started=1), InlineExecutor()
    module, name = STEPS[step]

    with monkeypatch.context() as patched:
        patched.setattr(trial_queue, "release", lambda *_: None)
        patched.setattr(module, name, killed(getattr(module, name), 3, before=before))
        with pytest.raises(Killed):
            StudyWorker(open_study(database, "small"), executor, worker=dead).work()
    after = run_study(small(room))

    repeated = step == "a run is stored" and before
    assert len(executor.executed) + len(after.executed) == 4 * 3 + repeated
    assert study_digest(database, "small") == study_digest(calm, "small")
    told = optuna.load_study(study_name="small", storage=optuna_storage(database)).trials
    assert [trial.state for trial in told] == [TrialState.COMPLETE] * 4


FOUR_OPTIONS: dict[str, Any] = {
    "filter.max_error": {"low": 3e-4, "high": 0.1, "log": True},
    "robust.scale": {"low": 0.01, "high": 10.0, "log": True},
    "robust.kernel": {"values": ["trivial", "huber", "cauchy"]},
    "tracks.min_length": {"low": 2, "high": 9},
}


@pytest.mark.parametrize("sampler", ["random", "tpe", "qmc"])
def test_a_worker_killed_while_it_chooses_options_leaves_the_choice_as_it_would_have_been(
    sampler: str, room: Path, tmp_path: Path, database: Database, run_study: Runner, monkeypatch: pytest.MonkeyPatch
) -> None:
    gtf = {"clean_runs": 1, "noisy_runs": 2}
    data = definition_of(room, space=FOUR_OPTIONS, gtf=gtf, search={"sampler": sampler, "trials": 4})
    calm = create_database(str(tmp_path / "calm.db"))
    for one in (calm, database):
        create_study(one, checked_definition(data, "test"), tmp_path)
    StudyWorker(open_study(calm, "small"), InlineExecutor()).work()
    dead = replace(this_worker(), pid_started=1)

    with monkeypatch.context() as patched:
        patched.setattr(trial_queue, "release", lambda *_: None)
        # Four options of trial 0, then two of trial 1.
        patched.setattr(optuna.trial.Trial, "_suggest", killed(optuna.trial.Trial._suggest, 7, before=True))
        with pytest.raises(Killed):
            StudyWorker(open_study(database, "small"), InlineExecutor(), worker=dead).work()
    run_study(data)

    assert study_digest(database, "small") == study_digest(calm, "small")


class Meanwhile:
    """Do something once, after the fifth run of a study."""

    def __init__(self, deed: Callable[[], object]) -> None:
        self.deed = deed
        self.runs = 0

    def __call__(self, event: Event) -> None:
        self.runs += isinstance(event, RunFinished)
        if self.runs == 5 and isinstance(event, RunFinished):
            self.deed()


def test_trials_that_are_added_while_a_worker_works_are_done_by_the_next_one(
    room: Path, database: Database, run_study: Runner
) -> None:
    run_study(small(room), callbacks=[Meanwhile(lambda: extend_study(database, "small", Extension(trials=6)))])
    between = studies.get(database, "small").state
    run_study(small(room))

    assert between == "open"
    assert studies.get(database, "small").state == "done"
    assert len(trials.of_study(database, studies.get(database, "small").id)) == 6


def test_rescoring_while_a_worker_works_disturbs_nothing(room: Path, database: Database, run_study: Runner) -> None:
    seen: list[int] = []

    run_study(
        small(room),
        callbacks=[Meanwhile(lambda: seen.append(len(rescore(database, "small", {"aggregate": "median"}).trials)))],
    )

    assert seen == [1]
    assert studies.get(database, "small").state == "done"


def test_a_study_that_is_copied_while_a_worker_works_is_whole_and_can_be_finished(
    room: Path, tmp_path: Path, database: Database, run_study: Runner
) -> None:
    other = create_database(str(tmp_path / "other.db"))

    run_study(small(room), callbacks=[Meanwhile(lambda: copy_study(database, other, "small"))])
    StudyWorker(open_study(other, "small"), InlineExecutor()).work()

    assert study_digest(other, "small") == study_digest(database, "small")


def test_a_study_that_is_deleted_while_a_worker_works_is_one_sentence(
    room: Path, database: Database, run_study: Runner
) -> None:
    with pytest.raises(DeletedError, match="was deleted"):
        run_study(small(room), callbacks=[Meanwhile(lambda: studies.delete_study(database, "small"))])

    assert studies.names(database) == []


def test_a_worker_goes_on_with_other_studies_when_one_is_deleted(room: Path, database: Database) -> None:
    for name in ("small", "other"):
        create_study(database, checked_definition({**small(room), "name": name}, "test"), room)
    said: list[str] = []
    deed = Meanwhile(lambda: studies.delete_study(database, "small"))

    WorkerLoop(database, InlineExecutor(), WorkerRules(), announce=said.append, callback_of=lambda study: deed).run()

    assert "study 'small' was deleted; its trial in work is dropped" in said
    assert studies.get(database, "other").state == "done"


class EndedWithItsHost(InlineExecutor):
    """Fail from the fifth run on, as runs do whose processes a batch system ends together with the worker."""

    def __init__(self, stop: StopRequest) -> None:
        super().__init__()
        self._stop = stop

    def submit(
        self, request: RunRequest, limits: RunLimits, known_good: RunRequest | None = None
    ) -> "Future[RunOutcome]":
        future = super().submit(request, limits, known_good)
        if len(self.executed) < 5:
            return future
        self._stop.ask(FINISH_RUNS)
        ended: Future[RunOutcome] = Future()
        ended.set_result(replace(future.result(), status="failed", error="the pipeline crashed its process (SIGTERM)"))
        return ended


def test_a_run_that_fails_while_the_worker_is_asked_to_stop_is_tried_again(
    room: Path, tmp_path: Path, database: Database, run_study: Runner
) -> None:
    create_study(database, checked_definition(small(room), "test"), tmp_path)
    stop = StopRequest()

    done = StudyWorker(open_study(database, "small"), EndedWithItsHost(stop), stop).work()
    run_study(small(room))

    assert not done
    assert all(one.feasible for one in trials.of_study(database, open_study(database, "small").record.id))
