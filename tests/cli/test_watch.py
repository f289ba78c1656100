from collections.abc import Callable
from pathlib import Path

import pytest
from sqlalchemy import text

from gtf_tune.cli.study import watch
from gtf_tune.store import studies, trial_queue
from gtf_tune.store.database import Database, open_database
from gtf_tune.store.trial_queue import Worker
from tests.cli.conftest import Cli
from tests.cli.test_study_commands import AXIS, CREATE

WORKER = Worker("anna:7", "anna", "another machine", 7, 7)


class Looks:
    """Stand-in for the pause between two looks: each one does something, the last one is Ctrl-C."""

    def __init__(self, *steps: Callable[[], object]) -> None:
        self._steps = list(steps)

    def __call__(self, _: float) -> None:
        if not self._steps:
            raise KeyboardInterrupt
        self._steps.pop(0)()


@pytest.fixture
def database(cli: Cli, room: Path) -> Database:
    cli(*CREATE, *AXIS)
    return open_database("gtf-tune.db")


def watched(cli: Cli, monkeypatch: pytest.MonkeyPatch, *steps: Callable[[], object]) -> list[str]:
    monkeypatch.setattr(watch.time, "sleep", Looks(*steps))
    return [line for line in cli("study", "watch", "small").err.splitlines() if "storage:" not in line]


def lease(database: Database) -> None:
    trial_queue.lease_trial(database, studies.get(database, "small").id, 4, WORKER)


def silence(database: Database, seconds: int) -> None:
    with database.engine.begin() as connection:
        connection.execute(text("UPDATE gtf_trial SET heartbeat_at = heartbeat_at - :s"), {"s": seconds})


def test_watch_says_who_works_where_and_when_that_changes(
    cli: Cli, database: Database, monkeypatch: pytest.MonkeyPatch
) -> None:
    lease(database)

    said = watched(cli, monkeypatch, lambda: None, lambda: silence(database, 90))

    assert said[0].startswith("anna:7 on anna: trial 0, last heard of 0")
    assert said[1].startswith("anna:7 on anna: trial 0, last heard of 1 min 30 s ago")


def test_watch_says_when_nobody_works(cli: Cli, database: Database, monkeypatch: pytest.MonkeyPatch) -> None:
    said = watched(cli, monkeypatch, lambda: None, lambda: None)

    assert said[:1] == ["study 'small': nobody works on it; go on with: gtf-tune study resume small"]
    assert len([line for line in said if "nobody" in line]) == 1


def test_a_worker_that_has_died_counts_as_nobody(cli: Cli, database: Database, monkeypatch: pytest.MonkeyPatch) -> None:
    lease(database)
    silence(database, 500)

    said = watched(cli, monkeypatch, lambda: None)

    assert "nobody works on it" in said[0]
