"""Databases that restart, drop connections, fill up, or whose clock jumps."""

import random
from collections.abc import Callable
from pathlib import Path

import pytest
from sqlalchemy import text
from sqlalchemy.orm import Session

from gtf_tune.errors import GtfTuneError, StorageError
from gtf_tune.execution import FreshStages, InlineExecutor, LocalExecutor, StageCache
from gtf_tune.report.dashboard.writer import turn_to_write
from gtf_tune.store import studies
from gtf_tune.store.database import create_database, open_database, wait_for_database
from gtf_tune.store.database.session import write
from gtf_tune.store.maintenance.copy import copy_study
from gtf_tune.study.create import checked_definition, create_study
from gtf_tune.study.open_study import open_study
from gtf_tune.study.work.worker import StudyWorker
from tests.faults.conftest import Disturb
from tests.faults.counted import LOG_VARIABLE, PAUSE_VARIABLE
from tests.faults.disks import SmallDisk
from tests.faults.disturbance import NAME, wait_until
from tests.faults.servers import RestartableServer, pooled
from tests.study.conftest import definition_of, write_sequence

DROP = "SELECT pg_terminate_backend(pid) FROM pg_stat_activity WHERE application_name = 'gtf-tune'"


@pytest.mark.parametrize("mode", ["fast", "immediate"])
def test_workers_wait_for_a_server_that_restarts(
    mode: str, restartable_server: RestartableServer, disturb: Disturb, undisturbed: Callable[..., str]
) -> None:
    study = disturb(restartable_server.new_storage())
    study.create()
    workers = [study.start(pause_s=0.05) for _ in range(2)]

    wait_until(lambda: len(study.begun()) >= 6)
    restartable_server.control("restart", "-m", mode)
    study.finish(workers)

    study.check(undisturbed())


def test_connections_that_are_dropped_at_any_moment_are_made_again(
    restartable_server: RestartableServer, disturb: Disturb, undisturbed: Callable[..., str]
) -> None:
    study = disturb(restartable_server.new_storage())
    study.create()
    workers = [study.start(pause_s=0.02) for _ in range(2)]
    chance = random.Random(0)

    wait_until(lambda: study.begun())
    while any(worker.is_alive() for worker in workers):
        restartable_server.execute(DROP)
        workers[0].join(chance.uniform(0.1, 0.5))
    study.finish(workers)

    study.check(undisturbed())


def test_a_turn_to_write_whose_connection_is_dropped_is_free_again(restartable_server: RestartableServer) -> None:
    database = open_database(restartable_server.new_storage())

    with turn_to_write(database, 1) as first:
        restartable_server.execute(DROP)
    with turn_to_write(database, 1) as second:
        assert (first, second) == (True, True)

    database.close()


def test_a_clock_that_jumps_costs_nothing(
    disturb: Disturb, make_storage: Callable[..., str], undisturbed: Callable[..., str]
) -> None:
    study = disturb(make_storage("postgresql", True))
    study.create()
    workers = [study.start(pause_s=0.05) for _ in range(2)]
    database = open_database(study.storage)

    for seconds in (3600, -3600, 86400):
        begun = len(study.begun())
        wait_until(lambda begun=begun: len(study.begun()) > begun + 2 or not any(one.is_alive() for one in workers))
        with database.engine.begin() as connection:
            # To the workers it looks as if the database's clock had jumped the other way.
            jump = text("UPDATE gtf_trial SET heartbeat_at = heartbeat_at + :seconds WHERE state = 'claimed'")
            connection.execute(jump, {"seconds": seconds})
    database.close()
    study.finish(workers)

    study.check(undisturbed())


def test_a_study_on_a_full_disk_says_so_and_goes_on_when_there_is_room(
    small_disk: SmallDisk, disturb: Disturb, undisturbed: Callable[..., str], monkeypatch: pytest.MonkeyPatch
) -> None:
    study = disturb(f"sqlite:///{small_disk.folder}/study.db")
    study.create()
    database = open_database(study.storage)
    monkeypatch.setenv(LOG_VARIABLE, str(study.log))
    monkeypatch.setenv(PAUSE_VARIABLE, "0")
    opened = open_study(database, NAME)
    small_disk.fill()

    with pytest.raises(StorageError, match=r"disk is full|check the disk") as caught:
        StudyWorker(opened, InlineExecutor()).work()
    small_disk.free()
    database.close()
    study.witness()
    study.finish()

    assert "\n" not in str(caught.value)
    study.check(undisturbed())


@pytest.mark.parametrize("room_kb", [60, 120, 200, 260])
def test_a_disk_that_fills_up_while_a_storage_is_made_is_one_sentence(room_kb: int, small_disk: SmallDisk) -> None:
    small_disk.fill()
    with (small_disk.folder / "filler").open("ab") as filler:
        filler.truncate(filler.tell() - room_kb * 1024)

    with pytest.raises(StorageError, match=r"disk is full|check the disk"):
        create_database(f"sqlite:///{small_disk.folder}/study.db")


def test_a_disk_that_is_full_when_a_study_is_created_is_one_sentence(small_disk: SmallDisk, tmp_path: Path) -> None:
    database = create_database(f"sqlite:///{small_disk.folder}/study.db")
    definition = checked_definition(definition_of(write_sequence(tmp_path / "room", ground_truth=False)), "test")
    small_disk.fill()

    with pytest.raises(StorageError, match=r"disk is full|check the disk"):
        create_study(database, definition, tmp_path)
    small_disk.free()
    assert create_study(database, definition, tmp_path).name == "small"


def test_a_disk_that_is_full_when_a_study_is_copied_is_one_sentence(small_disk: SmallDisk, tmp_path: Path) -> None:
    source = create_database(str(tmp_path / "source.db"))
    target = create_database(f"sqlite:///{small_disk.folder}/study.db")
    data = definition_of(write_sequence(tmp_path / "room", ground_truth=False))
    create_study(source, checked_definition(data, "test"), tmp_path)
    small_disk.fill()

    with pytest.raises(StorageError, match=r"disk is full|check the disk"):
        copy_study(source, target, "small")


@pytest.mark.parametrize("what", ["cache", "scratch"])
def test_a_full_disk_under_the_cache_or_the_images_stops_the_study_and_spoils_no_run(
    what: str,
    small_disk: SmallDisk,
    disturb: Disturb,
    undisturbed: Callable[..., str],
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    stages = {"pipeline": {"settings": {"stages": "yes"}}}
    study = disturb(f"sqlite:///{tmp_path}/study.db")
    study.create(**stages)
    store = StageCache(small_disk.folder / "cache") if what == "cache" else FreshStages()
    scratch = tmp_path / "scratch" if what == "cache" else small_disk.folder / "scratch"
    database = open_database(study.storage)
    monkeypatch.setenv(LOG_VARIABLE, str(study.log))
    monkeypatch.setenv(PAUSE_VARIABLE, "0")
    small_disk.fill()

    with LocalExecutor(1, store, scratch) as executor, pytest.raises(GtfTuneError, match="No space left on device"):
        StudyWorker(open_study(database, NAME), executor).work()
    small_disk.free()
    database.close()
    study.witness()
    study.finish()

    study.check(undisturbed(**stages))


def test_a_wrong_password_is_said_at_once_and_not_waited_for(restartable_server: RestartableServer) -> None:
    storage = restartable_server.new_storage()
    with restartable_server.rules.open("r+") as rules:
        others = rules.read()
        rules.seek(0)
        rules.write(f"host all joe 127.0.0.1/32 scram-sha-256\n{others}")
    restartable_server.execute("CREATE ROLE joe LOGIN PASSWORD 'right'")
    restartable_server.execute("SELECT pg_reload_conf()")

    for wrong in ("joe:wrong@", "joe@"):
        with pytest.raises(StorageError, match="refuses the user, the password or the name of the database"):
            wait_for_database(storage.replace("postgres@", wrong), patience_s=60)


def test_a_server_that_has_become_a_standby_is_left_for_the_one_that_took_its_place(
    restartable_server: RestartableServer,
) -> None:
    database = open_database(restartable_server.new_storage())
    servers: list[int] = []

    def write_something(session: Session) -> None:
        servers.append(session.scalar(text("SELECT pg_backend_pid()")) or 0)
        if len(servers) == 1:
            session.execute(text("SET TRANSACTION READ ONLY"))
        session.execute(text("CREATE TABLE after_failover (id integer)"))

    write(database, write_something)

    assert len(set(servers)) == 2
    database.close()


def test_two_processes_share_the_connections_of_a_pool_of_transactions(restartable_server: RestartableServer) -> None:
    """PgBouncer before 1.21 knows no prepared statements, of which the driver would make one at the sixth query."""
    storage = restartable_server.new_storage()
    with pooled(restartable_server) as port:
        url = storage.replace(f":{restartable_server.port}/", f":{port}/")
        databases = [open_database(url) for _ in range(2)]
        for _ in range(10):
            assert [studies.names(database) for database in databases] == [[], []]
        with turn_to_write(databases[0], 1) as first, turn_to_write(databases[1], 1) as second:
            assert (first, second) == (True, False)
        with turn_to_write(databases[1], 1) as second:
            assert second
        for database in databases:
            database.close()
