from collections.abc import Callable

import pytest
from sqlalchemy import text

from gtf_tune.errors import StorageError
from gtf_tune.pipelines.run import RunOutcome, RunRequest
from gtf_tune.store import confirmations, runs, studies, trial_queue
from gtf_tune.store.database import Database, open_database
from gtf_tune.store.database.schema import REVISIONS
from gtf_tune.store.maintenance.check import check
from gtf_tune.store.optuna.link import delete_linked
from gtf_tune.store.optuna.rows import NUMBER_KEY
from gtf_tune.store.optuna.tables import optuna_storage
from gtf_tune.store.runs import TrialRun
from gtf_tune.store.studies import Study
from gtf_tune.store.trial_queue import TrialResult, this_worker


@pytest.fixture
def used(
    database: Database,
    study: Study,
    make_request: Callable[..., RunRequest],
    make_outcome: Callable[..., RunOutcome],
) -> Database:
    """Return a database with one complete trial of one run."""
    from optuna.trial import TrialState, create_trial

    storage = optuna_storage(database)
    lease = trial_queue.lease_trial(database, study.id, 9, this_worker())
    assert lease is not None
    template = create_trial(state=TrialState.RUNNING, system_attrs={NUMBER_KEY: 0})
    optuna_id = storage.create_new_trial(study.optuna_study_id, template)
    trial_queue.attach_optuna_trial(database, lease, optuna_id, 0, {})
    saved = runs.save(database, make_request(), make_outcome())
    runs.link(database, lease.trial_id, [TrialRun(0, "desk", saved, reused=False)])
    trial_queue.finish(database, lease, TrialResult("complete", value=0.5, feasible=True))
    storage.set_trial_state_values(optuna_id, TrialState.COMPLETE, [0.5])
    return database


def execute(database: Database, statement: str, **values: object) -> None:
    with database.engine.begin() as connection:
        connection.execute(text(statement), values)


def test_a_sound_database_has_no_problems(used: Database) -> None:
    report = check(used)
    assert (report.ok, report.problems, report.notes) == (True, (), ())
    assert (report.revision, report.studies, report.trials, report.runs) == (REVISIONS[-1], 1, 1, 1)


def test_a_damaged_trajectory_is_a_problem(used: Database) -> None:
    execute(used, "UPDATE gtf_run_output SET trajectory = :none", none=b"none")
    (problem,) = check(used).problems
    assert "is damaged" in problem


def test_a_lost_trajectory_is_a_problem(used: Database) -> None:
    execute(used, "DELETE FROM gtf_run_output")
    (problem,) = check(used).problems
    assert "has lost its trajectory" in problem


def test_a_lost_optuna_study_is_a_problem(used: Database, study: Study) -> None:
    delete_linked(used, study)
    (problem,) = check(used).problems
    assert "another program deleted the Optuna study of 'room'" in problem


def test_a_trial_without_an_optuna_trial_is_a_problem(used: Database) -> None:
    execute(used, "UPDATE gtf_trial SET optuna_number = 99, optuna_trial_id = 99")
    (problem,) = check(used).problems
    assert "another program deleted the Optuna study of 'room'" in problem
    assert "or trials of it" in problem


def test_a_missing_trial_is_a_problem(used: Database) -> None:
    execute(used, "UPDATE gtf_trial SET ordinal = 2")
    execute(used, "UPDATE trial_system_attributes SET value_json = '2'")
    assert check(used).problems == ("study 'room' lacks 2 of its trials 0 to 2; restore a backup",)


def test_a_score_without_runs_is_a_problem(used: Database) -> None:
    execute(used, "DELETE FROM gtf_trial_run")
    assert check(used).problems == ("trial 0 of study 'room' has a score but no runs; restore a backup",)


def test_a_score_that_optuna_has_not_is_a_problem(used: Database) -> None:
    execute(used, "DELETE FROM trial_values")
    assert check(used).problems == ("trial 0 of study 'room' has another score in Optuna's tables; restore a backup",)


@pytest.mark.parametrize(
    ("table", "column"), [("gtf_study", "definition"), ("gtf_trial", "options"), ("gtf_run", "options")]
)
def test_a_text_that_is_no_json_is_a_problem(used: Database, table: str, column: str) -> None:
    execute(used, f"UPDATE {table} SET {column} = '{{oops'")
    assert check(used).problems == (f"'{column}' of row 1 in {table} is damaged; restore a backup",)


def test_lost_tables_and_columns_are_named_in_one_sentence(used: Database) -> None:
    execute(used, "DROP TABLE gtf_run_output")
    execute(used, "ALTER TABLE gtf_trial DROP COLUMN message")
    with pytest.raises(StorageError, match=r"tables or columns gtf_run_output, gtf_trial\.message; restore"):
        check(used)


def test_rows_without_their_owner_are_a_problem(make_storage: Callable[[str, bool], str]) -> None:
    database = open_database(make_storage("sqlite", True))
    with database.engine.connect() as connection:
        cursor = connection.connection.cursor()
        cursor.execute("PRAGMA foreign_keys = OFF")
        cursor.execute("INSERT INTO gtf_validation VALUES (7, 'desk', 0.1, '{}')")
        cursor.close()
    (problem,) = check(database).problems
    database.close()
    assert problem.startswith("1 rows of gtf_validation refer to missing rows of gtf_trial")


def test_leftovers_are_notes(
    used: Database, study: Study, make_request: Callable[..., RunRequest], make_outcome: Callable[..., RunOutcome]
) -> None:
    runs.save(used, make_request("clean", 5), make_outcome(5))
    studies.set_state(used, study.id, "copying")
    report = check(used)
    assert report.ok
    assert [note.split(" ")[0] for note in report.notes] == ["1", "study"]


def test_runs_of_a_confirmation_are_no_leftovers(
    used: Database, study: Study, make_request: Callable[..., RunRequest], make_outcome: Callable[..., RunOutcome]
) -> None:
    confirmed = [runs.save(used, make_request("clean", index), make_outcome(index)).key for index in (5, 6)]
    runs.save(used, make_request("clean", 7), make_outcome(7))
    confirmations.add(used, study.id, {"run_keys": confirmed}, {}, "adopt")

    (note,) = check(used).notes

    assert note.startswith("1 runs belong to no trial and no confirmation")
