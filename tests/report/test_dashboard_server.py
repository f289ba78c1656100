import http.client
import json
import threading
import time
from collections.abc import Callable, Iterator
from pathlib import Path

import optuna
import pytest

from gtf_tune.errors import DefinitionError
from gtf_tune.report.dashboard import server as server_module
from gtf_tune.report.dashboard import upkeep
from gtf_tune.report.dashboard.server import DashboardServer, serve_dashboard
from gtf_tune.report.dashboard.sync import DashboardSync
from gtf_tune.report.dashboard.writer import artifact_folder
from gtf_tune.store.database import Database
from gtf_tune.store.optuna.tables import optuna_storage


@pytest.fixture
def server(own_database: Database) -> Iterator[DashboardServer]:
    """Yield a dashboard on a copy of the storage that answers requests."""
    with DashboardServer(own_database, port=0) as running:
        thread = threading.Thread(target=running.serve)
        thread.start()
        yield running
        running.stop()
        thread.join()


def get(server: DashboardServer, path: str, host: str = "") -> tuple[int, str]:
    address = server.url.removeprefix("http://")
    connection = http.client.HTTPConnection(address, timeout=20)
    connection.request("GET", path, headers={"Host": host or address})
    response = connection.getresponse()
    found = response.status, response.read().decode()
    connection.close()
    return found


def test_the_dashboard_serves_the_studies_of_the_storage(server: DashboardServer) -> None:
    status, body = get(server, "/api/studies")

    assert status == 200
    names = [one["study_name"] for one in json.loads(body)["study_summaries"]]
    assert names == ["synthetic", "two", "single", "empty"]


def test_the_dashboard_serves_what_the_sync_wrote(own_database: Database, server: DashboardServer) -> None:
    DashboardSync(own_database, "synthetic").write_study()
    DashboardSync(own_database, "synthetic").write_trial(3)

    study = json.loads(get(server, "/api/studies/1")[1])
    trial = study["trials"][3]
    artifact = next(one for one in trial["artifacts"] if one["filename"] == "walk.svg")

    assert study["objective_names"] == ["GTF ATE [‰ of extent]"]
    assert trial["values"] == [3.42949]
    assert {"key": "gtf_ate [‰ of extent]", "value": "3.42949"} in trial["user_attrs"]
    assert study["user_attrs"][0]["key"] == "read first"
    assert "/dashboard/studies/1/note" in study["user_attrs"][0]["value"]
    assert "against nominal -38.0 % (95 % interval " in trial["note"]["body"]
    assert get(server, f"/artifacts/1/{trial['trial_id']}/{artifact['artifact_id']}")[1].startswith("<svg")


def test_the_best_trial_of_the_dashboard_is_the_recommended_one(
    own_database: Database, server: DashboardServer, confirm_study: Callable[[Database, str], None]
) -> None:
    before = json.loads(get(server, "/api/studies/1")[1])["best_trials"]
    confirm_study(own_database, "keep nominal")
    after = json.loads(get(server, "/api/studies/1")[1])["best_trials"]

    assert [trial["number"] for trial in (*before, *after)] == [3, 0]


def test_scores_that_are_ratios_are_shown_as_they_are_stored(server: DashboardServer) -> None:
    study = json.loads(get(server, "/api/studies/2")[1])

    assert study["trials"][0]["values"] == [1.0]


def test_a_study_that_is_not_ours_is_shown_as_it_is(own_database: Database, server: DashboardServer) -> None:
    foreign = optuna.create_study(study_name="foreign", storage=optuna_storage(own_database))
    foreign.add_trial(optuna.trial.create_trial(value=0.25))

    study = json.loads(get(server, f"/api/studies/{foreign._study_id}")[1])

    assert study["trials"][0]["values"] == [0.25]


def test_a_page_under_another_name_gets_no_answer(server: DashboardServer) -> None:
    assert get(server, "/api/studies", host="attacker.example")[0] == 403
    assert get(server, "/api/studies", host="localhost:1")[0] == 200


def test_a_taken_port_is_an_error_that_says_what_to_do(own_database: Database, server: DashboardServer) -> None:
    port = int(server.url.rpartition(":")[2])

    with pytest.raises(DefinitionError, match=f"cannot listen on 127.0.0.1:{port} .*choose another port"):
        DashboardServer(own_database, port=port)


def test_the_link_is_announced_and_opened_unless_told_not_to(
    own_database: Database, monkeypatch: pytest.MonkeyPatch
) -> None:
    said: list[str] = []
    opened: list[str] = []
    monkeypatch.setattr(server_module.webbrowser, "open", opened.append)
    monkeypatch.setattr(DashboardServer, "serve", _interrupt)

    serve_dashboard(own_database, port=0, announce=said.append)
    serve_dashboard(own_database, port=0, announce=said.append, open_browser=False)

    assert opened[0] in said[0]
    assert len(opened) == 1
    assert said[1] == "dashboard ended"


def test_notes_are_written_while_the_dashboard_is_served(
    own_database: Database, monkeypatch: pytest.MonkeyPatch
) -> None:
    syncs = [DashboardSync(own_database, name) for name in ("synthetic", "two", "single", "empty")]

    def serve(_: DashboardServer) -> None:
        give_up_at = time.monotonic() + 60
        while not all(one.is_current() for one in syncs) and time.monotonic() < give_up_at:
            time.sleep(0.05)

    monkeypatch.setattr(DashboardServer, "serve", serve)
    said: list[str] = []

    serve_dashboard(own_database, port=0, announce=said.append, open_browser=False)

    assert [one.is_current() for one in syncs] == [True] * 4
    assert len(said) == 1


def test_upkeep_warns_once_and_goes_on(own_database: Database, monkeypatch: pytest.MonkeyPatch) -> None:
    rounds = threading.Semaphore(0)

    def refuse(_: str) -> Database:
        rounds.release()
        raise OSError("gone away")

    monkeypatch.setattr(upkeep, "open_database", refuse)
    said: list[str] = []

    with upkeep.Upkeep(own_database, warn=said.append, refresh_s=0.0):
        assert all(rounds.acquire(timeout=20) for _ in range(3))

    assert said == ["optuna-dashboard's content could not be brought up to date (gone away)"]


def test_an_address_that_others_reach_is_warned_of(own_database: Database, monkeypatch: pytest.MonkeyPatch) -> None:
    said: list[str] = []
    monkeypatch.setattr(DashboardServer, "serve", _interrupt)

    serve_dashboard(own_database, "0.0.0.0", 0, announce=said.append, open_browser=False)

    assert said[0].startswith("warning: anybody who can reach 0.0.0.0 can change and delete studies")


def test_files_lie_beside_a_sqlite_file_unless_a_folder_is_given(own_database: Database, tmp_path: Path) -> None:
    assert artifact_folder(own_database) == tmp_path / "own.db-artifacts"
    assert artifact_folder(own_database, tmp_path / "elsewhere") == tmp_path / "elsewhere"


def _interrupt(_: DashboardServer) -> None:
    raise KeyboardInterrupt
