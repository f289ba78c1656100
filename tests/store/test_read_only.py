"""SQLite files that can only be read, by their mode, their folder's, or the lack of files beside them."""

import shutil
import sqlite3
from collections.abc import Callable, Iterator
from contextlib import closing
from pathlib import Path

import pytest

from gtf_tune.store import studies
from gtf_tune.store.database import engine, open_database
from gtf_tune.store.database.engine import connect_read_only
from gtf_tune.store.maintenance.check import check
from gtf_tune.store.maintenance.digest import study_digest
from gtf_tune.store.studies import Study
from tests.store.conftest import as_nobody


@pytest.fixture
def file(sqlite_template: Path, public_folder: Path, make_study: Callable[..., Study]) -> Path:
    """Return a SQLite file with one study in a folder that others may enter, with nothing beside it."""
    path = public_folder / "a 100% ?#.db"
    shutil.copy(sqlite_template, path)
    database = open_database(str(path))
    make_study(database)
    database.close()
    assert list(public_folder.iterdir()) == [path]
    return path


@pytest.fixture
def written_to(file: Path) -> Iterator[Path]:
    """Return the file while another process works on it: its study is called 'hall' only in the write-ahead log."""
    with closing(sqlite3.connect(file, isolation_level=None)) as writer:
        writer.execute("PRAGMA wal_autocheckpoint = 0")
        writer.execute("UPDATE gtf_study SET name = 'hall'")
        yield file


def _read(path: Path) -> tuple[object, ...]:
    with closing(open_database(str(path))) as database:
        (name,) = studies.names(database)
        return name, study_digest(database, name), check(database).ok


def _names(path: Path) -> list[str]:
    return studies.names(open_database(str(path)))


def _pause(path: Path) -> None:
    database = open_database(str(path))
    studies.set_state(database, studies.get(database, "room").id, "paused")


def _delete(path: Path) -> None:
    studies.delete_study(open_database(str(path)), "room")


@pytest.mark.parametrize(("file_mode", "folder_mode"), [(0o444, 0o755), (0o666, 0o555), (0o444, 0o555)])
def test_a_file_that_cannot_be_written_is_read_like_another(file: Path, file_mode: int, folder_mode: int) -> None:
    expected = _read(file)
    content = file.read_bytes()
    file.chmod(file_mode)
    file.parent.chmod(folder_mode)

    assert as_nobody(lambda: _read(file)) == str(expected)
    assert (file.read_bytes(), list(file.parent.iterdir())) == (content, [file])


def test_changes_beside_a_file_are_read_while_their_writer_works(written_to: Path) -> None:
    written_to.parent.chmod(0o555)

    assert as_nobody(lambda: _names(written_to)) == "['hall']"


def test_changes_that_cannot_be_read_are_never_left_out(written_to: Path, public_folder: Path) -> None:
    copy = public_folder / "copy" / "x.db"
    copy.parent.mkdir()
    shutil.copy(written_to, copy)
    shutil.copy(f"{written_to}-wal", f"{copy}-wal")
    copy.parent.chmod(0o555)

    message = as_nobody(lambda: _names(copy))

    assert message.startswith(f"{copy} cannot be read here, because its last changes are still in x.db-wal")
    assert "copy x.db and x.db-wal to a folder of yours" in message


def test_what_others_write_later_is_seen(file: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(engine, "can_write", lambda _: False)
    database = open_database(str(file))
    before = studies.names(database)
    with closing(sqlite3.connect(file, isolation_level=None)) as writer:
        writer.execute("UPDATE gtf_study SET name = 'hall'")

    assert (before, studies.names(database)) == (["room"], ["hall"])


@pytest.mark.parametrize("change", [_pause, _delete])
def test_changing_it_is_one_sentence_with_the_way_out(file: Path, change: Callable[[Path], None]) -> None:
    content = file.read_bytes()
    file.chmod(0o444)

    message = as_nobody(lambda: change(file))

    assert "cannot be written to; get write permission for the file and its folder, or copy the file" in message
    assert file.read_bytes() == content


def test_a_file_without_write_ahead_log_is_locked_for_reading(tmp_path: Path) -> None:
    path = tmp_path / "x.db"
    with closing(sqlite3.connect(path, isolation_level=None)) as writer:
        writer.execute("CREATE TABLE note (text)")
        with closing(connect_read_only(path, 0.1)) as reader:
            reader.execute("BEGIN")
            reader.execute("SELECT * FROM note").fetchall()
            writer.execute("PRAGMA busy_timeout = 0")
            with pytest.raises(sqlite3.OperationalError, match="locked"):
                writer.execute("INSERT INTO note VALUES ('later')")
