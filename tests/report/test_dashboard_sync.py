import csv
import io
import json
import sqlite3
import threading
from collections.abc import Callable
from pathlib import Path
from typing import Any
from xml.etree import ElementTree

import optuna_dashboard
import pytest
from sqlalchemy.exc import OperationalError

from gtf_tune.report.dashboard import notes
from gtf_tune.report.dashboard.sync import DashboardSync
from gtf_tune.report.dashboard.writer import artifact_folder, turn_to_write
from gtf_tune.report.study_data import read_search, read_trials
from gtf_tune.store import trials
from gtf_tune.store.database import Database, connect
from gtf_tune.store.optuna.tables import optuna_storage
from gtf_tune.store.trial_queue import TrialResult
from gtf_tune.study.events import TrialFinished

STUDY_ID = 1


def end(number: int) -> TrialFinished:
    return TrialFinished(number, {}, TrialResult("complete"))


@pytest.fixture
def synced(own_database: Database) -> DashboardSync:
    """Return a sync of ``synthetic`` that fails loudly."""

    def fail(message: str) -> None:
        raise AssertionError(message)

    return DashboardSync(own_database, "synthetic", warn=fail)


def attributes(database: Database) -> dict[str, Any]:
    return optuna_storage(database).get_study_system_attrs(STUDY_ID)


def figures(database: Database) -> dict[str, Any]:
    parts: dict[str, dict[int, str]] = {}
    for key, value in attributes(database).items():
        if key.startswith("dashboard:plot_data:"):
            name, number = key.removeprefix("dashboard:plot_data:").rsplit(":", 1)
            parts.setdefault(name, {})[int(number)] = value
    return {name: json.loads("".join(part[index] for index in sorted(part))) for name, part in parts.items()}


def files(database: Database, prefix: str) -> dict[str, bytes]:
    folder = artifact_folder(database)
    assert folder is not None
    records = [json.loads(value) for key, value in attributes(database).items() if key.startswith(prefix)]
    return {one["filename"]: (folder / one["artifact_id"]).read_bytes() for one in records}


def trial_files(database: Database, number: int) -> dict[str, bytes]:
    return files(database, f"dashboard:artifacts:{trials.get(database, STUDY_ID, number).optuna_trial_id}:")


def test_a_trial_that_has_finished_gets_its_note_and_its_files(own_database: Database, synced: DashboardSync) -> None:
    synced.on_event(end(3))

    found = trial_files(own_database, 3)
    rows = list(csv.DictReader(io.StringIO(found["matrix.csv"].decode())))
    assert (len(rows), rows[0]["collapsed"]) == (8, "no")
    assert ElementTree.fromstring(found["walk.svg"]).tag.endswith("svg")


def test_the_note_of_a_trial_compares_its_options_with_nominal(own_database: Database) -> None:
    note = notes.trial_note(read_trials(own_database, "synthetic", [0, 3]), 3)

    assert "GTF ATE **3.43** ‰ of extent" in note
    assert "| `filter.max_error`\u2003 | `0.01`\u2003 | **`0.002`**\u2003 |" in note


def test_a_trial_with_failed_runs_shows_their_reason_and_their_log(
    own_database: Database, synced: DashboardSync
) -> None:
    synced.write_trial(6)

    note = notes.trial_note(read_trials(own_database, "synthetic", [0, 6]), 6)
    assert "**infeasible**: `the pipeline crashed its process (SIGABRT)`" in note
    log = trial_files(own_database, 6)["failed-runs.log"].decode()
    assert "=== walk, noisy run 2: the pipeline crashed its process (SIGABRT) ===" in log
    assert "Check failed" in log


def test_a_study_gets_its_note_its_figures_and_its_files(own_database: Database, synced: DashboardSync) -> None:
    synced.bring_up_to_date()

    assert "# Trial 3 is the best so far; not confirmed yet" in notes_of_study(own_database)
    found = figures(own_database)
    assert found["gtf-option-filter.max_error-walk"]["layout"]["title"]["text"] == "filter.max_error"
    assert {"gtf-matrix-walk-best", "gtf-matrix-walk-nominal", "gtf-coverage"} <= found.keys()
    assert files(own_database, "artifacts:").keys() == {"trials.csv", "options.json"}
    assert attributes(own_database)["study:metric_names"] == ["GTF ATE / extent"]


def notes_of_study(database: Database) -> str:
    body: str = optuna_dashboard.get_note(_study(database))
    return body


def _study(database: Database) -> Any:
    import optuna

    return optuna.load_study(study_name="synthetic", storage=optuna_storage(database))


def test_writing_again_replaces_instead_of_piling_up(own_database: Database, synced: DashboardSync) -> None:
    for _ in range(2):
        synced.write_study()
        synced.write_trial(3)
        before = len(attributes(own_database)), len(list((artifact_folder(own_database) or Path()).iterdir()))
    synced.write_study()
    synced.write_trial(3)

    assert before == (len(attributes(own_database)), len(list((artifact_folder(own_database) or Path()).iterdir())))


def test_what_a_user_wrote_below_the_line_is_kept(own_database: Database, synced: DashboardSync) -> None:
    synced.write_study()
    optuna_dashboard.save_note(_study(own_database), notes_of_study(own_database) + "\n\nMy own words.")

    synced.write_study()

    body = notes_of_study(own_database)
    assert body.endswith("\n\nMy own words.")
    assert body.count(notes.KEPT_BELOW) == 1


def test_a_note_that_a_user_began_is_kept_below(own_database: Database) -> None:
    note = notes.study_note(read_search(own_database, "synthetic"), "Mine.")

    assert note.endswith(f"{notes.KEPT_BELOW}\n\nMine.")


def test_nothing_is_written_again_a_short_time_after_the_last_time(
    own_database: Database, monkeypatch: pytest.MonkeyPatch
) -> None:
    written: list[int] = []
    monkeypatch.setattr(DashboardSync, "write_study", lambda self: written.append(1))
    synced = DashboardSync(own_database, "synthetic", refresh_s=1e6)

    for number in (1, 2, 3):
        synced.on_event(end(number))

    assert written == [1]


def test_the_end_brings_trials_up_to_date_that_dead_workers_left(own_database: Database, synced: DashboardSync) -> None:
    synced.bring_up_to_date()

    finished = [one.optuna_trial_id for one in trials.of_study(own_database, STUDY_ID)]
    assert all(f"dashboard:{one}:note_ver" in attributes(own_database) for one in finished)


def test_a_study_is_current_until_something_changes(
    own_database: Database, synced: DashboardSync, confirm_study: Callable[[Database, str], None]
) -> None:
    assert not synced.is_current()
    synced.bring_up_to_date()
    assert synced.is_current()

    confirm_study(own_database, "adopt")

    assert not synced.is_current()


def test_a_fault_is_one_warning_and_never_an_error(own_database: Database, monkeypatch: pytest.MonkeyPatch) -> None:
    warnings: list[str] = []
    monkeypatch.setattr(notes, "key_figures", lambda data: 1 / 0)
    synced = DashboardSync(own_database, "synthetic", warn=warnings.append, refresh_s=0.0)

    synced.bring_up_to_date()
    synced.on_event(end(3))
    synced.bring_up_to_date()

    assert len(warnings) == 1
    assert "all else goes on (division by zero)" in warnings[0]


def test_a_fault_of_the_database_is_one_line(own_database: Database, monkeypatch: pytest.MonkeyPatch) -> None:
    def refuse(data: object) -> None:
        raise OperationalError("SELECT 1", {}, sqlite3.OperationalError("went\n  away"))

    warnings: list[str] = []
    monkeypatch.setattr(notes, "key_figures", refuse)
    DashboardSync(own_database, "synthetic", warn=warnings.append, refresh_s=0.0).bring_up_to_date()

    assert "refused a request: went away; check the storage" in warnings[0]
    assert "\n" not in warnings[0]
    assert "SELECT" not in warnings[0]


def test_a_folder_that_cannot_be_made_is_a_warning(own_database: Database, tmp_path: Path) -> None:
    warnings: list[str] = []
    (tmp_path / "file").write_text("")
    synced = DashboardSync(own_database, "synthetic", artifacts=tmp_path / "file", warn=warnings.append)

    synced.on_event(end(3))

    assert len(warnings) == 1


def test_only_one_worker_at_a_time_writes_the_study(own_database: Database) -> None:
    with turn_to_write(own_database, STUDY_ID) as first, turn_to_write(own_database, STUDY_ID) as second:
        assert (first, second) == (True, False)
    with turn_to_write(own_database, STUDY_ID) as again:
        assert again


def test_a_worker_that_may_wait_gets_its_turn(own_database: Database) -> None:
    release, got = threading.Event(), threading.Event()

    def hold() -> None:
        with turn_to_write(own_database, STUDY_ID):
            got.set()
            release.wait(10)

    other = threading.Thread(target=hold)
    other.start()
    got.wait(10)
    threading.Timer(0.1, release.set).start()
    with turn_to_write(own_database, STUDY_ID, patience_s=10) as mine:
        assert mine
    other.join()


def test_turns_are_kept_on_a_server_too(make_storage: Callable[[str, bool], str]) -> None:
    database = connect(make_storage("postgresql", True))

    with turn_to_write(database, STUDY_ID) as first, turn_to_write(database, STUDY_ID) as second:
        assert (first, second) == (True, False)
    with turn_to_write(database, STUDY_ID, patience_s=1) as again:
        assert again
    assert artifact_folder(database) is None
    database.close()


def test_workers_that_write_side_by_side_leave_whole_figures(own_database: Database) -> None:
    workers = [DashboardSync(own_database, "synthetic", refresh_s=0.0) for _ in range(3)]
    threads = [threading.Thread(target=one.on_event, args=(end(number),)) for number, one in enumerate(workers)]

    for one in threads:
        one.start()
    for one in threads:
        one.join()

    assert all({"data", "layout"} <= figure.keys() for figure in figures(own_database).values())


def test_a_confirmed_study_says_so_in_its_note(
    own_database: Database, synced: DashboardSync, confirm_study: Callable[[Database, str], None]
) -> None:
    confirm_study(own_database, "adopt")

    synced.write_study()

    assert notes_of_study(own_database).startswith("# Adopt the options of trial 3")


@pytest.mark.parametrize(("study", "limit"), [("synthetic", "1 (1000 ‰ of extent)"), ("two", "1000000")])
def test_the_note_of_a_study_names_the_value_from_which_trials_are_infeasible(
    database: Database, study: str, limit: str
) -> None:
    note = notes.study_note(read_search(database, study))

    assert f"A trial with a value of {limit} or more is **infeasible**" in note
