"""What was interrupted half-way is said, repeated and cleaned up as if it had not been."""

import shutil
from pathlib import Path

import pytest

from gtf_tune.errors import StorageError
from gtf_tune.execution import InlineExecutor, RunLimits
from gtf_tune.store import confirmations, runs, studies
from gtf_tune.store.database import Database
from gtf_tune.store.maintenance.check import check
from gtf_tune.study.create import checked_definition, create_study
from gtf_tune.study.events import Event, NoiseStarted
from gtf_tune.study.open_study import OpenStudy, open_study
from gtf_tune.study.outcome.confirm import confirm, plan_confirmation
from gtf_tune.study.runs.run_source import RunSource
from gtf_tune.study.runs.stop import FINISH_RUNS, StopRequest
from gtf_tune.study.work.worker import StudyWorker
from tests.study.conftest import Runner, definition_of
from tests.study.conftest import database as database
from tests.study.conftest import room as room
from tests.study.conftest import run_study as run_study

GRID = {
    "pipeline": {"settings": {"collapse_rate": 0.0}},
    "space": {"filter.max_error": {"values": [0.01, 0.002]}},
    "search": {"sampler": "grid"},
}

AUTO = {"gtf": {"noise_sigma": "auto"}, "search": {"trials": 2}}


def source_of(database: Database) -> tuple[OpenStudy, RunSource]:
    return open_study(database, "small"), RunSource(database, InlineExecutor(), RunLimits(60, 2**30), StopRequest())


def test_a_confirmation_that_was_stored_but_never_said_is_said_when_repeated(
    room: Path, database: Database, run_study: Runner
) -> None:
    run_study(definition_of(room, **GRID))
    study, source = source_of(database)
    first = confirm(study, plan_confirmation(study, {}, top=1, noisy_runs=4), source)

    again = confirm(study, plan_confirmation(study, {}, top=1, noisy_runs=4), source)
    stored = confirmations.of_study(database, study.record.id)
    wider = plan_confirmation(study, {}, top=1, noisy_runs=5)
    other = plan_confirmation(study, {}, top=1, noisy_runs=4, again=True)

    assert (again, len(stored)) == (first, 1)
    assert (wider.round, other.round) == (2, 2)


def test_two_confirmations_at_once_are_one(room: Path, database: Database, run_study: Runner) -> None:
    run_study(definition_of(room, **GRID))
    study, source = source_of(database)
    plans = [plan_confirmation(study, {}, top=1, noisy_runs=4) for _ in range(2)]

    verdicts = [confirm(study, plan, source) for plan in plans]

    assert verdicts[0] == verdicts[1]
    assert len(confirmations.of_study(database, study.record.id)) == 1


def test_the_runs_by_which_a_noise_was_chosen_go_with_the_last_study_that_used_them(
    room: Path, database: Database, run_study: Runner
) -> None:
    run_study(definition_of(room, **AUTO))
    keys = studies.get(database, "small").resolved["noise_runs"]
    run_study({**definition_of(room, **AUTO), "name": "other"})
    stored = runs.find(database, keys)
    assert len(stored) > 3
    assert check(database).notes == ()

    studies.delete_study(database, "small")
    assert len(runs.find(database, keys)) == len(stored)
    studies.delete_study(database, "other")

    assert runs.find(database, keys) == {}
    assert check(database).runs == 0


def test_the_runs_of_an_interrupted_choice_of_the_noise_go_with_their_study(room: Path, database: Database) -> None:
    create_study(database, checked_definition(definition_of(room, **AUTO), "test"), room)
    stop, levels = StopRequest(), []

    def interrupt(event: Event) -> None:
        if isinstance(event, NoiseStarted):
            levels.append(event.sigma)
            if len(levels) == 3:
                stop.ask(FINISH_RUNS)

    StudyWorker(open_study(database, "small"), InlineExecutor(), stop, [interrupt]).work()
    assert check(database).runs > 6
    studies.delete_study(database, "small")

    assert check(database).runs == 0


@pytest.mark.parametrize("how", ["removed", "moved", "replaced"])
def test_a_file_that_disappears_while_it_is_open_is_noticed_at_the_next_step(
    how: str, database: Database, tmp_path: Path
) -> None:
    path = tmp_path / "study.db"
    assert studies.names(database) == []
    if how == "removed":
        path.unlink()
    else:
        path.rename(tmp_path / "elsewhere.db")
    if how == "replaced":
        shutil.copy(tmp_path / "elsewhere.db", path)

    with pytest.raises(StorageError, match="was removed, moved or replaced while it was in use"):
        studies.names(database)
    if how != "removed":
        (tmp_path / "elsewhere.db").replace(path)
        assert studies.names(database) == []
