import os
import signal
from collections.abc import Callable, Iterator
from contextlib import nullcontext, suppress

import pytest
from sqlalchemy import text
from sqlalchemy.exc import OperationalError
from sqlalchemy.orm import Session

from gtf_tune.errors import StorageError
from gtf_tune.store import studies
from gtf_tune.store.database import Database, engine, open_database, session
from gtf_tune.store.database.session import read, read_rows, write
from gtf_tune.store.optuna.tables import optuna_storage, with_optuna
from gtf_tune.store.studies import Study

ADD_NOTE = text("INSERT INTO note VALUES (1)")


@pytest.fixture(autouse=True)
def _no_pauses(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(session, "_pause", lambda seconds: None)


@pytest.fixture
def noted(database: Database) -> Database:
    with database.engine.begin() as connection:
        connection.execute(text("CREATE TABLE note (id INTEGER PRIMARY KEY)"))
    return database


def count(database: Database) -> int:
    return int(read_rows(database, text("SELECT count(*) FROM note"))[0][0])


def test_a_unit_of_work_is_all_or_nothing(noted: Database) -> None:
    def work(session: Session) -> None:
        session.execute(ADD_NOTE)
        raise ZeroDivisionError

    with pytest.raises(ZeroDivisionError):
        write(noted, work)
    assert count(noted) == 0


def test_a_row_that_another_inserted_first_is_found_on_the_second_attempt(noted: Database) -> None:
    attempts = []

    def work(session: Session) -> str:
        attempts.append(len(attempts))
        if len(attempts) == 1:
            session.execute(ADD_NOTE)
            session.execute(ADD_NOTE)
        return "done"

    assert write(noted, work) == "done"
    assert len(attempts) == 2
    assert count(noted) == 0


def test_a_fault_that_stays_is_given_up_with_one_sentence(noted: Database, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(session, "_GIVE_UP_AFTER_S", -1.0)
    write(noted, lambda session: session.execute(ADD_NOTE).close())
    with pytest.raises(StorageError, match=r"refused a request|no connection") as caught:
        write(noted, lambda session: session.execute(ADD_NOTE).close())
    assert "\n" not in str(caught.value)


def test_a_fault_of_ours_is_not_repeated(noted: Database) -> None:
    attempts = []

    def work(session: Session) -> None:
        attempts.append(1)
        session.execute(text("SELECT 1 FROM nowhere"))

    with pytest.raises(StorageError, match="nowhere"):
        write(noted, work)
    assert len(attempts) == 1


def test_readers_see_one_state_while_others_write(noted: Database) -> None:
    def work(session: Session) -> tuple[int, int]:
        query = text("SELECT count(*) FROM note")
        before = session.scalar(query)
        write(noted, lambda other: other.execute(ADD_NOTE).close())
        return before, session.scalar(query)

    assert read(noted, work) == (0, 0)
    assert count(noted) == 1


@pytest.mark.parametrize("goes_on", [False, True], ids=["which ends", "which goes on, as Optuna does"])
def test_a_connection_that_the_server_drops_in_a_transaction_is_made_again(
    make_storage: Callable[[str, bool], str], make_study: Callable[..., Study], goes_on: bool
) -> None:
    database = open_database(make_storage("postgresql", True))
    study = make_study(database)
    attempts = []

    def work(session: Session) -> None:
        attempts.append(1)
        session.execute(text("UPDATE gtf_study SET state = 'paused' WHERE id = :id"), {"id": study.id})
        if len(attempts) == 1:
            with suppress(OperationalError) if goes_on else nullcontext():
                session.execute(text("SELECT pg_terminate_backend(pg_backend_pid())"))
            session.execute(text("SELECT 1"))

    write(database, work)
    state = studies.get(database, study.name).state
    database.close()
    assert (len(attempts), state) == (2, "paused")


@pytest.fixture
def small_database(make_storage: Callable[[str, bool], str]) -> Iterator[Database]:
    """Yield a SQLite database that may not grow: SQLite then reports a full disk."""
    database = open_database(make_storage("sqlite", True))
    with database.engine.begin() as connection:
        pages = connection.execute(text("PRAGMA page_count")).scalar()
        connection.execute(text(f"PRAGMA max_page_count = {pages}"))
    yield database
    database.close()


def test_a_full_disk_is_one_sentence_and_loses_nothing(small_database: Database) -> None:
    def work(session: Session) -> None:
        session.execute(text("UPDATE alembic_version SET version_num = 'lost'"))
        session.execute(text("CREATE TABLE bulk AS SELECT zeroblob(1000000)"))

    with pytest.raises(StorageError, match="because the disk is full; free some space"):
        write(small_database, work)
    assert read_rows(small_database, text("SELECT version_num FROM alembic_version")) != [("lost",)]


def test_a_locked_database_is_one_sentence(
    make_storage: Callable[[str, bool], str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(session, "_GIVE_UP_AFTER_S", -1.0)
    monkeypatch.setattr(engine, "_LOCK_TIMEOUT_S", 0)
    storage = make_storage("sqlite", True)
    holder, other = open_database(storage), open_database(storage)
    with holder.engine.begin(), pytest.raises(StorageError, match="is locked by another process"):
        write(other, lambda session: session.execute(text("SELECT 1")).close())
    holder.close()
    other.close()


def test_optuna_waits_for_a_lock_like_we_do(
    make_storage: Callable[[str, bool], str], monkeypatch: pytest.MonkeyPatch
) -> None:
    from optuna.study import StudyDirection

    monkeypatch.setattr(engine, "_LOCK_TIMEOUT_S", 0)
    storage = make_storage("sqlite", True)
    holder, other = open_database(storage), open_database(storage)
    rdb = optuna_storage(other)
    lock = holder.engine.begin()
    lock.__enter__()
    monkeypatch.setattr(session, "_pause", lambda seconds: lock.__exit__(None, None, None))

    created = with_optuna(other, lambda: rdb.create_new_study([StudyDirection.MINIMIZE], "toy"))

    assert rdb.get_study_name_from_id(created) == "toy"
    holder.close()
    other.close()


def test_a_killed_writer_leaves_the_file_usable(make_storage: Callable[[str, bool], str]) -> None:
    storage = make_storage("sqlite", True)
    child = os.fork()
    if child == 0:
        database = open_database(storage)
        write(database, lambda session: session.execute(text("CREATE TABLE kept (id INTEGER)")).close())

        def work(session: Session) -> None:
            session.execute(text("CREATE TABLE lost (id INTEGER)"))
            os.kill(os.getpid(), signal.SIGKILL)

        write(database, work)
    os.waitpid(child, 0)
    database = open_database(storage)
    tables = {row[0] for row in read_rows(database, text("SELECT name FROM sqlite_master"))}
    database.close()
    assert "kept" in tables
    assert "lost" not in tables
