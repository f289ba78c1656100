"""What is wrong with one study, or with this machine, costs neither the other studies nor the verdicts."""

from concurrent.futures import Future
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import cv2
import pytest
from sqlalchemy import delete, select, update

from gtf_tune.cli.parameters import make_executor
from gtf_tune.definition import LimitsDefinition
from gtf_tune.errors import MachineError, SequenceError
from gtf_tune.execution import InlineExecutor, RunLimits
from gtf_tune.pipelines import RunOutcome, create_pipeline
from gtf_tune.pipelines.run import RunRequest
from gtf_tune.report.dashboard.notes import study_note
from gtf_tune.report.study_data import read_search
from gtf_tune.sequence import load_sequence
from gtf_tune.store import runs, studies, trial_queue
from gtf_tune.store.database import Database, models
from gtf_tune.store.database.session import read_rows, write
from gtf_tune.store.trial_queue import this_worker
from gtf_tune.study.create import checked_definition, create_study
from gtf_tune.study.events import Event, TrialSetAside
from gtf_tune.study.open_study import open_study
from gtf_tune.study.runs.stop import StopRequest
from gtf_tune.study.work.server import WorkerLoop, WorkerRules
from gtf_tune.study.work.worker import StudyWorker
from tests.execution.doubles import SEQUENCE
from tests.study.conftest import definition_of

LIMITS = RunLimits(60.0, 2**30)


def create(database: Database, room: Path, name: str = "small", **sections: Any) -> None:
    seed = sum(name.encode())  # studies of one seed would share their runs
    data = definition_of(room, name=name, search={"sampler": "random", "trials": 3, "seed": seed}, **sections)
    create_study(database, checked_definition(data, "test"), room)


def serve(database: Database) -> list[str]:
    said: list[str] = []
    WorkerLoop(database, InlineExecutor(), WorkerRules(), announce=said.append).run()
    return said


def lose_a_run(database: Database) -> None:
    """Delete a run that the nominal trial uses, as a study that shared it does when it is deleted by hand."""
    StudyWorker(open_study(database, "bad"), InlineExecutor()).work()
    studies.set_state(database, studies.get(database, "bad").id, "open")
    some = select(models.Run.id).limit(1).scalar_subquery()
    write(database, lambda session: session.execute(delete(models.RunOutput).where(models.RunOutput.run_id == some)))
    again = update(models.Trial).values(state="claimed", lease=None)
    write(database, lambda session: session.execute(again))


def ask_for_endless_memory(database: Database) -> None:
    row = studies.get(database, "bad")
    definition = row.definition.replace('"run_memory_gb": 8.0', '"run_memory_gb": 1e300')
    assert definition != row.definition
    studies.replace_definition(database, row.id, definition)


@pytest.mark.parametrize("harm", [lose_a_run, ask_for_endless_memory])
def test_a_study_that_cannot_be_worked_on_is_set_aside_and_the_others_are_served(
    database: Database, room: Path, harm: Any
) -> None:
    create(database, room, "bad")
    harm(database)
    create(database, room, "good")

    said = serve(database)

    assert studies.get(database, "good").state == "done"
    assert any(text.startswith("study 'bad' is left to other workers: ") for text in said)
    assert not any("Traceback" in text for text in said)


@pytest.mark.parametrize(("name", "value"), [("run_memory_gb", 1e300), ("run_timeout_s", 1e300), ("run_memory_gb", -1)])
def test_limits_are_bounded(name: str, value: float) -> None:
    with pytest.raises(ValueError, match=name):
        LimitsDefinition(**{name: value})


@dataclass
class FullDisk(InlineExecutor):
    """Behave like an executor whose disk is full after some runs."""

    room_for: int = 2
    executed: list[RunRequest] = field(default_factory=list)

    def __post_init__(self) -> None:
        super().__init__()

    def submit(self, request: RunRequest, limits: RunLimits, known_good: RunRequest | None = None) -> Any:
        future = super().submit(request, limits, known_good)
        if len(self.executed) > self.room_for:
            outcome: RunOutcome = future.result()
            empty = replace(outcome, status="failed", error="the disk is full", cause="machine")
            future = type(future)()
            future.set_result(replace(empty, trajectory=outcome.trajectory.select(slice(0, 0))))
        return future


def test_a_fault_of_the_machine_is_stored_and_ends_the_work_but_is_never_reused(database: Database, room: Path) -> None:
    create(database, room)

    with pytest.raises(MachineError, match="the disk is full"):
        StudyWorker(open_study(database, "small"), FullDisk()).work()
    stored = read_rows(database, select(models.Run.status, models.Run.diagnostics))
    StudyWorker(open_study(database, "small"), InlineExecutor()).work()

    assert [found["failure"] for status, found in stored if status == "failed"] == ["machine"]
    (fault,) = runs.machine_faults(database, studies.get(database, "small").id)
    assert (fault.reason, fault.runs) == ("the disk is full", 1)
    assert studies.get(database, "small").state == "done"
    (summary,) = studies.summaries(database)
    assert (summary.complete, summary.infeasible) == (3, 0)
    said = f"1 run failed because of {fault.host}, not of the configuration: the disk is full"
    assert said in study_note(read_search(database, "small")).replace("\\", "")
    studies.delete_study(database, "small")
    assert read_rows(database, select(models.Run.id)) == []


class BadNode(InlineExecutor):
    """Behave like an executor on a machine where every run fails."""

    def submit(self, request: RunRequest, limits: RunLimits, known_good: RunRequest | None = None) -> Any:
        outcome: RunOutcome = super().submit(request, limits, known_good).result()
        future: Future[RunOutcome] = Future()
        nothing = outcome.trajectory.select(slice(0, 0))
        future.set_result(replace(outcome, status="failed", error="no library here", trajectory=nothing))
        return future


def on_host(database: Database, host: str, executor: InlineExecutor, said: list[str] | None = None) -> StudyWorker:
    def note(event: Event) -> None:
        if isinstance(event, TrialSetAside) and said is not None:
            said.append(event.text)

    worker = replace(this_worker(), name=host, host=host, machine=host)
    return StudyWorker(open_study(database, "small"), executor, StopRequest(), [note], worker=worker)


@pytest.mark.parametrize("sigma", [5.0, "auto"])
def test_a_machine_on_which_everything_fails_leaves_nominal_to_another_host(
    database: Database, room: Path, monkeypatch: pytest.MonkeyPatch, sigma: float | str
) -> None:
    monkeypatch.setattr(Database, "is_shared", True)
    create(database, room, gtf={"noise_sigma": sigma})
    said: list[str] = []
    bad, good = on_host(database, "bad", BadNode(), said), on_host(database, "good", InlineExecutor())

    assert not bad.work_while_free()
    ((state, host, message),) = read_rows(database, select(models.Trial.state, models.Trial.host, models.Trial.message))
    assert good.work()

    assert said == [TrialSetAside(0, "no library here").text]
    assert (state, host) == ("claimed", "bad")
    assert message.endswith("no library here")
    (summary,) = studies.summaries(database)
    assert (summary.complete, summary.infeasible) == (3, 0)


def test_a_failure_of_nominal_counts_where_no_other_machine_takes_it(
    database: Database, room: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(Database, "is_shared", True)
    monkeypatch.setattr(trial_queue, "SET_ASIDE_S", 0.0)
    create(database, room)

    assert on_host(database, "only", BadNode()).work()

    (summary,) = studies.summaries(database)
    assert (summary.complete, summary.infeasible) == (3, 3)


def test_pixels_that_change_while_a_study_is_open_end_its_work(database: Database, room: Path) -> None:
    create(database, room)
    study = open_study(database, "small")
    first = sorted((room / "rgb").glob("*.png"))[0]
    image = cv2.imread(str(first), cv2.IMREAD_GRAYSCALE)
    image[0, 0] += 100
    cv2.imwrite(str(first), image)

    with pytest.raises(SequenceError, match="were changed while they were worked on"):
        StudyWorker(study, InlineExecutor()).work()
    assert read_rows(database, select(models.Run.id)) == []


def test_files_that_were_only_touched_are_compared_by_their_pixels(room: Path) -> None:
    sequence = load_sequence(room)
    assert sequence.fingerprint
    for path in (room / "rgb").glob("*.png"):
        path.touch()

    sequence.check_unchanged()


def test_programs_run_with_a_relative_cache_folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    settings = {"arguments": ["/bin/sh", "-c", "exit 3"], "output": {"path": "poses.txt", "format": "tum"}}
    request = RunRequest(create_pipeline("command", settings), {}, SEQUENCE, "clean", 0, 0.0, 0, 0)

    with make_executor(1, Path("cache")) as executor:
        outcome = executor.submit(request, LIMITS).result(60.0)

    assert "ended with exit code 3" in outcome.error
