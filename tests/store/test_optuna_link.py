"""The Optuna study of a study on both databases: found again, gone, or filled by others; tables of other versions."""

from collections.abc import Callable
from pathlib import Path

import optuna
import pytest
from optuna.storages import RDBStorage
from optuna.study import StudyDirection
from optuna.trial import TrialState, create_trial
from sqlalchemy import text

from gtf_tune.errors import OptunaStudyError, StorageError
from gtf_tune.store import studies, trial_queue, trials
from gtf_tune.store.database import Database, create_database, open_database, upgrade_database
from gtf_tune.store.optuna.link import linked
from gtf_tune.store.optuna.rows import NUMBER_KEY
from gtf_tune.store.optuna.tables import optuna_storage
from gtf_tune.store.studies import Study
from gtf_tune.store.trial_queue import TrialResult, this_worker
from tests.faults import other_programs


@pytest.fixture
def begun(database: Database, study: Study) -> Study:
    """Return a study with a complete trial and one in work."""
    storage = optuna_storage(database)
    for number in range(2):
        lease = trial_queue.lease_trial(database, study.id, 9, this_worker())
        assert lease is not None
        template = create_trial(state=TrialState.RUNNING, system_attrs={NUMBER_KEY: number})
        trial_id = storage.create_new_trial(study.optuna_study_id, template)
        trial_queue.attach_optuna_trial(database, lease, trial_id, number, {})
        if number == 0:
            trial_queue.finish(database, lease, TrialResult("complete", value=0.5, feasible=True))
            storage.set_trial_state_values(trial_id, TrialState.COMPLETE, [0.5])
    return study


def test_a_renamed_study_is_linked_again_with_its_trials(database: Database, begun: Study) -> None:
    other_programs.rename(database, "room")

    found = linked(database, begun)

    copies = optuna_storage(database).get_all_trials(found.optuna_study_id)
    assert found == studies.get(database, "room")
    assert found.optuna_study_id == other_programs.load(database, "renamed")._study_id
    assert [one.optuna_trial_id for one in trials.of_study(database, begun.id)] == [one._trial_id for one in copies]


def test_a_trial_that_a_copy_lacks_is_begun_again(database: Database, begun: Study) -> None:
    kept = other_programs.load(database, "room").get_trials(deepcopy=False)[:1]
    other_programs.delete(database, "room")
    optuna.create_study(study_name="copy", storage=optuna_storage(database)).add_trials(kept)

    linked(database, begun)

    assert [one.optuna_trial_id is None for one in trials.of_study(database, begun.id)] == [False, True]


def test_a_deleted_study_is_an_error(database: Database, begun: Study) -> None:
    other_programs.delete(database, "room")

    with pytest.raises(OptunaStudyError, match="deleted the Optuna study of 'room'"):
        linked(database, begun)


def test_a_search_sees_its_own_trials_only(database: Database, begun: Study) -> None:
    theirs = other_programs.load(database, "room")
    theirs.add_trial(create_trial(value=-1.0))
    theirs.ask()
    # A trial of ours that someone else ended, and that was begun again since, has the number too.
    theirs.add_trial(create_trial(value=-1.0, system_attrs={NUMBER_KEY: 0}))

    seen = optuna_storage(database, of_search=True).get_all_trials(begun.optuna_study_id)

    assert [trial.number for trial in seen] == [0, 1]
    assert len(optuna_storage(database).get_all_trials(begun.optuna_study_id)) == 5


def execute(storage: str, statement: str) -> None:
    database = open_database(storage)
    with database.engine.begin() as connection:
        connection.execute(text(statement))
    database.close()


@pytest.mark.parametrize(
    "change", ["UPDATE alembic_version SET version_num = 'v9.9.9.a'", "UPDATE version_info SET schema_version = 99"]
)
def test_tables_of_a_newer_optuna_are_refused_with_what_to_do(storage: str, change: str) -> None:
    execute(storage, change)
    database = open_database(storage)

    for attempt in (lambda: optuna_storage(database), lambda: upgrade_database(storage)):
        with pytest.raises(StorageError, match=r"were made by a newer Optuna .* install the newer Optuna"):
            attempt()
    database.close()


@pytest.mark.parametrize(
    ("prepare", "reason"),
    [
        (
            "UPDATE alembic_version SET version_num = 'v3.0.0.d'",
            "older Optuna .* make a backup, then upgrade the storage",
        ),
        ("UPDATE alembic_version SET version_num = 'v9.9.9.a'", "newer Optuna .* install the newer Optuna"),
    ],
)
def test_tables_of_others_are_not_upgraded_unasked(empty_storage: str, prepare: str, reason: str) -> None:
    add_optuna_study(empty_storage)
    change = create_other(empty_storage)
    change(prepare)
    before = change("SELECT version_num FROM alembic_version")

    with pytest.raises(StorageError, match=reason):
        create_database(empty_storage)

    assert change("SELECT version_num FROM alembic_version") == before
    assert change("SELECT study_name FROM studies") == ["theirs"]


def test_older_tables_are_upgraded_when_asked(empty_storage: str) -> None:
    add_optuna_study(empty_storage)
    create_other(empty_storage)("UPDATE alembic_version SET version_num = 'v3.0.0.d'")

    said: list[str] = []
    database = upgrade_database(empty_storage, said.append)
    upgrade_database(empty_storage, said.append).close()

    assert [one.study_name for one in optuna_storage(database).get_all_studies()] == ["theirs"]
    database.close()
    if not empty_storage.startswith("sqlite"):
        return
    (line,) = said
    backup = line.split(" to ")[1].split(" before ")[0]
    assert create_other(f"sqlite:///{backup}")("SELECT version_num FROM alembic_version") == ["v3.0.0.d"]


def test_the_tables_of_a_present_optuna_are_joined(empty_storage: str) -> None:
    add_optuna_study(empty_storage)

    database = create_database(empty_storage)

    assert [one.study_name for one in optuna_storage(database).get_all_studies()] == ["theirs"]
    database.close()


def test_a_revision_of_another_program_is_not_taken_for_optunas(empty_storage: str) -> None:
    create_other(empty_storage)("CREATE TABLE alembic_version (version_num VARCHAR(32))")
    create_other(empty_storage)("INSERT INTO alembic_version VALUES ('1a2b3c')")

    with pytest.raises(StorageError, match="holds the table alembic_version of another program"):
        create_database(empty_storage)


def add_optuna_study(url: str) -> None:
    """Make Optuna's tables and a study as any program does."""
    storage = RDBStorage(url)
    storage.create_new_study([StudyDirection.MINIMIZE], "theirs")
    storage.remove_session()
    storage.engine.dispose()


def create_other(storage: str) -> Callable[[str], list[str]]:
    """Return a function that executes a statement as another program does, and returns the first column."""
    from sqlalchemy import create_engine

    def execute(statement: str) -> list[str]:
        if storage.startswith("sqlite:///"):
            Path(storage.removeprefix("sqlite:///")).touch()
        engine = create_engine(storage)
        with engine.begin() as connection:
            found = connection.execute(text(statement))
            rows = [row[0] for row in found] if found.returns_rows else []
        engine.dispose()
        return rows

    return execute
