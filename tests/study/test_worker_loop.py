import math
import threading
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import pytest

from gtf_tune.errors import StorageError
from gtf_tune.execution import InlineExecutor
from gtf_tune.store import studies, trial_queue, trials
from gtf_tune.store.database import Database
from gtf_tune.store.trial_queue import this_worker
from gtf_tune.study.create import checked_definition, create_study
from gtf_tune.study.events import Event, RunFinished
from gtf_tune.study.open_study import SequencePlaces, open_study
from gtf_tune.study.runs.stop import STOP_NOW, StopRequest
from gtf_tune.study.states import pause_study, reopen_study, stop_study
from gtf_tune.study.work.server import WorkerLoop, WorkerRules
from gtf_tune.study.work.worker import StudyWorker
from tests.study.conftest import definition_of, write_sequence

Create = Callable[..., studies.Study]


@pytest.fixture
def create(room: Path, database: Database) -> Create:
    """Create a small study of random settings."""

    def make(name: str = "small", **sections: object) -> studies.Study:
        data = definition_of(room, name=name, search={"sampler": "random", "trials": 3}, **sections)
        return create_study(database, checked_definition(data, "test"), room)

    return make


def serve(database: Database, rules: WorkerRules | None = None, stop: StopRequest | None = None) -> list[str]:
    """Serve until nothing is left to do, and return what was announced."""
    said: list[str] = []
    server = WorkerLoop(database, InlineExecutor(), rules or WorkerRules(), stop or StopRequest(), said.append)
    server.run()
    return said


def states(database: Database) -> dict[str, str]:
    return {one.name: one.state for one in studies.summaries(database)}


def test_a_study_that_cannot_be_compared_does_not_stop_the_others(
    database: Database, create: Create, room: Path, tmp_path: Path
) -> None:
    tiny = write_sequence(tmp_path / "tiny", ground_truth=False, frames=6)
    both = [{"name": "room", "path": str(room)}, {"name": "tiny", "path": str(tiny)}]
    broken = {"name": "analytic", "settings": {"failure": "error", "failure_rate": "1"}}
    create("pair", sequences=both, pipeline=broken)
    create("good")

    said = serve(database)

    assert states(database)["good"] == "done"
    assert any("'pair' is left to other workers" in one and "no score on" in one for one in said)


def test_a_worker_does_every_open_study_and_leaves_the_others(database: Database, create: Create) -> None:
    for name in ("one", "two", "three"):
        create(name)
    pause_study(database, "two")

    serve(database)

    assert states(database) == {"one": "done", "two": "paused", "three": "done"}


def test_only_the_named_studies_are_served(database: Database, create: Create) -> None:
    create("one")
    create("two")

    serve(database, WorkerRules(names=("two",)))

    assert states(database) == {"one": "open", "two": "done"}


def test_a_study_whose_images_are_missing_is_left_to_others_with_the_reason(
    database: Database, create: Create, room: Path, tmp_path: Path
) -> None:
    create()
    room.rename(tmp_path / "elsewhere")

    (said,) = serve(database)

    assert said == (
        f"study 'small' is left to other workers: sequence 'room' is not at {room} on this machine; say where it lies"
    )
    assert states(database) == {"small": "open"}


def test_sequences_are_found_by_name_below_the_data_root(
    database: Database, create: Create, room: Path, tmp_path: Path
) -> None:
    create()
    (tmp_path / "here").mkdir()
    room.rename(tmp_path / "here" / "room")

    serve(database, WorkerRules(places=SequencePlaces(data_root=tmp_path / "here")))

    assert states(database) == {"small": "done"}


def test_a_sequence_that_is_not_below_the_data_root_is_named(
    database: Database, create: Create, tmp_path: Path
) -> None:
    create()

    (said,) = serve(database, WorkerRules(places=SequencePlaces(data_root=tmp_path / "room" / "rgb")))

    assert "sequence 'room' is not in" in said
    assert said.endswith("say where it lies")


def test_other_pixels_are_refused_with_the_reason(
    database: Database, create: Create, room: Path, tmp_path: Path
) -> None:
    create()
    other = write_sequence(tmp_path / "other", ground_truth=False)
    (other / "rgb" / "000003.png").write_bytes((other / "rgb" / "000004.png").read_bytes())

    (said,) = serve(database, WorkerRules(places=SequencePlaces(named={"room": other})))

    assert "has other pixels than when the study began" in said


def test_another_version_is_refused_or_recorded_as_asked(
    database: Database, create: Create, monkeypatch: pytest.MonkeyPatch
) -> None:
    study = create()
    monkeypatch.setattr("gtf_tune.pipelines.analytic.pipeline.VERSION", "2")

    (refused,) = serve(database)
    serve(database, WorkerRules(allow_version_mismatch=True))

    assert "began with analytic 1, but 2 is installed here" in refused
    first = trials.get(database, study.id, 0)
    assert trials.details(database, [first.id])[first.id]["version_mismatch"].endswith("2 is installed here")
    noted = "began with analytic 1, but 2 is installed here"
    assert trials.version_mismatches(database, study.id) == {0: noted, 1: noted, 2: noted}
    assert trials.version_mismatches(database, study.id, [1, 7]) == {1: noted}


def test_a_worker_leaves_when_it_was_idle_for_long_enough(database: Database) -> None:
    assert serve(database, WorkerRules(idle_exit_s=0.2)) == []


def test_a_worker_that_waits_for_studies_ends_when_asked(database: Database) -> None:
    stop = StopRequest()
    stop.ask(STOP_NOW)

    assert serve(database, WorkerRules(idle_exit_s=math.inf), stop) == []


def test_a_worker_takes_over_from_one_that_dies_late(database: Database, create: Create) -> None:
    study = create()
    elsewhere = replace(this_worker("there"), machine="another machine")
    lease = trial_queue.lease_trial(database, study.id, 3, elsewhere)
    assert lease is not None

    serve(database, WorkerRules(grace_s=0.3))

    assert [one.attempts for one in trials.of_study(database, study.id)] == [2, 1, 1]
    assert states(database) == {"small": "done"}


def test_an_unfinished_copy_is_never_worked_on(database: Database, create: Create) -> None:
    studies.set_state(database, create().id, "copying")

    with pytest.raises(StorageError, match="unfinished copy; delete it and copy it again"):
        studies.check_open(studies.get(database, "small"))
    assert serve(database) == []


def test_a_stopped_study_opens_again(database: Database, create: Create) -> None:
    create()
    stop_study(database, "small")

    with pytest.raises(StorageError, match="is stopped; resume it"):
        studies.check_open(studies.get(database, "small"))
    studies.check_open(reopen_study(database, "small"))
    serve(database)

    assert states(database) == {"small": "done"}
    with pytest.raises(StorageError, match="is done, so there is nothing to stop"):
        pause_study(database, "small")


def test_stopping_a_study_interrupts_its_trial_and_keeps_its_runs(database: Database, create: Create) -> None:
    study = create()
    heard = threading.Event()

    def stop_after_first_run(event: Event) -> None:
        if isinstance(event, RunFinished):
            if studies.state(database, study.id) == "open":
                stop_study(database, "small")
            heard.wait(30)

    class Observed(StudyWorker):
        def _stop_with_study(self, stop: StopRequest) -> None:
            super()._stop_with_study(stop)
            if stop.level:
                heard.set()

    worker = Observed(open_study(database, "small"), InlineExecutor(), callbacks=[stop_after_first_run], beat_s=0.05)
    assert not worker.work()

    (trial,) = trials.of_study(database, study.id)
    assert (trial.state, trial.heartbeat_at) == ("claimed", None)
    serve(database)
    assert states(database) == {"small": "stopped"}
