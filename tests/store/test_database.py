import multiprocessing
import os
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path

import pytest
from sqlalchemy import inspect, make_url, text

from gtf_tune.errors import StorageError
from gtf_tune.store.database import connect, create_database, open_database, schema, upgrade_database
from gtf_tune.store.optuna.tables import optuna_storage
from tests.store.conftest import as_nobody


def test_creating_makes_our_tables_beside_optunas(empty_storage: str) -> None:
    database = create_database(empty_storage)
    tables = set(inspect(database.engine).get_table_names())
    database.close()
    assert {"alembic_version", "gtf_alembic_version", "trials", "gtf_trial", "gtf_run_output"} <= tables


def test_creating_twice_changes_nothing(storage: str) -> None:
    create_database(storage).close()
    create_database(storage).close()


def _create(storage: str) -> None:
    create_database(storage).close()


def test_many_processes_create_one_database_at_once(empty_storage: str) -> None:
    import optuna.storages  # once, before the processes fork  # noqa: F401

    context = multiprocessing.get_context("fork")
    processes = [context.Process(target=_create, args=(empty_storage,)) for _ in range(24)]
    for process in processes:
        process.start()
    for process in processes:
        process.join()
    assert [process.exitcode for process in processes] == [0] * 24
    open_database(empty_storage).close()


def test_tables_are_added_to_a_database_that_optuna_made(make_storage: Callable[[str, bool], str]) -> None:
    from optuna.storages import RDBStorage

    storage = make_storage("sqlite", False)
    RDBStorage(storage).engine.dispose()
    with pytest.raises(StorageError, match="no tables of gtf-tune yet; create a study in it, or upgrade the storage"):
        open_database(storage)
    upgrade_database(storage).close()
    open_database(storage).close()


def test_a_missing_file_says_which_command_makes_it(tmp_path: Path) -> None:
    with pytest.raises(StorageError, match=r"no storage at .*x\.db; create a study in it first"):
        open_database(f"{tmp_path}/x.db")
    assert not (tmp_path / "x.db").exists()


def test_a_missing_folder_is_named(tmp_path: Path) -> None:
    with pytest.raises(StorageError, match="none of the storage does not exist"):
        create_database(f"{tmp_path}/none/x.db")


@pytest.mark.parametrize("action", [open_database, create_database, upgrade_database])
def test_a_folder_is_no_storage(tmp_path: Path, action: Callable[[str], object]) -> None:
    with pytest.raises(StorageError, match="is a folder"):
        action(str(tmp_path))


@pytest.mark.parametrize("action", [open_database, create_database, upgrade_database])
def test_a_file_of_something_else_is_refused_and_kept(tmp_path: Path, action: Callable[[str], object]) -> None:
    path = tmp_path / "x.db"
    path.write_text("name = 'a study'\n" * 100)
    with pytest.raises(StorageError, match="is not a SQLite database"):
        action(str(path))
    assert path.read_text() == "name = 'a study'\n" * 100


def test_creating_in_a_read_only_folder_is_one_sentence(public_folder: Path) -> None:
    public_folder.chmod(0o555)

    message = as_nobody(lambda: create_database(f"{public_folder}/new.db"))

    assert "cannot be" in message
    assert str(public_folder) in message


@pytest.mark.parametrize("action", [open_database, create_database, upgrade_database])
def test_a_folder_that_may_not_be_entered_is_one_sentence(public_folder: Path, action: Callable[[str], object]) -> None:
    path = public_folder / "private" / "studies" / "x.db"
    path.parent.mkdir(parents=True)
    path.parent.parent.chmod(0o700 if os.geteuid() == 0 else 0o000)

    message = as_nobody(lambda: action(str(path)))
    path.parent.parent.chmod(0o700)

    assert message.startswith(str(path.parent))
    assert message.endswith(" cannot be reached (Permission denied); choose a storage in another folder")


def test_tables_of_a_newer_version_are_refused(storage: str) -> None:
    database = connect(storage)
    with database.engine.begin() as connection:
        connection.execute(text("UPDATE gtf_alembic_version SET version_num = '9999'"))
    database.close()
    for action in (open_database, create_database, upgrade_database):
        with pytest.raises(StorageError, match=r"newer gtf-tune .*; install the newer gtf-tune"):
            action(storage)


def test_tables_of_an_older_version_name_the_command(storage: str, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(schema, "REVISIONS", ("0001", "0002"))
    with pytest.raises(StorageError, match=r"older gtf-tune .*; upgrade it"):
        open_database(storage)


def test_a_server_that_does_not_answer_is_one_sentence_without_password() -> None:
    pytest.importorskip("psycopg")
    with pytest.raises(StorageError, match="no connection to") as caught:
        open_database("postgresql://me:s3cret@127.0.0.1:1/gtf")
    assert "s3cret" not in str(caught.value)
    assert "\n" not in str(caught.value)


def test_a_missing_driver_names_the_extra(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "psycopg", None)
    with pytest.raises(StorageError, match=r"pip install 'gtf-tune\[postgres\]'"):
        open_database("postgresql://me@127.0.0.1:1/gtf")


def test_braces_in_a_password_reach_optuna_unharmed() -> None:
    url = make_url("postgresql+psycopg://me:a%7Bb@host/{data}")
    assert schema.optuna_url(url).format(SCHEMA_VERSION=1) == url.render_as_string(hide_password=False)


def test_optuna_works_on_the_same_connections(storage: str) -> None:
    import optuna

    database = open_database(storage)
    study = optuna.create_study(storage=optuna_storage(database), study_name="toy")
    study.optimize(lambda trial: trial.suggest_float("x", 0, 1), n_trials=3)
    finished = len(study.trials)
    database.close()
    assert finished == 3


def test_optuna_tables_of_another_revision_are_refused(storage: str) -> None:
    database = open_database(storage)
    with database.engine.begin() as connection:
        connection.execute(text("UPDATE alembic_version SET version_num = 'v2.6.0.a'"))
    with pytest.raises(StorageError, match=r"made by an older Optuna \(revision v2\.6\.0\.a, .* upgrade the storage"):
        optuna_storage(database)
    database.close()


def test_importing_the_store_does_not_import_optuna() -> None:
    records = "database, studies, trial_queue, trials, runs, ground_truth_errors, confirmations"
    rooms = f"from gtf_tune.store import {records}; from gtf_tune.store.maintenance import copy, check, digest"
    code = f"import sys; {rooms}; sys.exit('optuna' in sys.modules)"
    assert subprocess.run([sys.executable, "-c", code], check=False).returncode == 0
