from pathlib import Path

import pytest

from gtf_tune.errors import StorageError
from gtf_tune.store.database.engine import display_url, parse_url, without_passwords


@pytest.mark.parametrize(
    ("storage", "shown"),
    [
        ("studies.db", "sqlite:///studies.db"),
        ("sqlite:////data/studies.db", "sqlite:////data/studies.db"),
        ("postgresql://me@host:5433/gtf", "postgresql+psycopg://me@host:5433/gtf"),
        ("postgres+psycopg2://me@host/gtf", None),
        ("postgresql+psycopg2://me@host/gtf", "postgresql+psycopg://me@host/gtf"),
        ("postgresql+psycopg://me:s3cret@host/gtf", "postgresql+psycopg://me:***@host/gtf"),
        ("postgresql://host/gtf?user=me&password=s3cret", "postgresql+psycopg://host/gtf?password=%2A%2A%2A&user=me"),
    ],
)
def test_urls_are_read_and_shown_without_passwords(storage: str, shown: str | None) -> None:
    if shown is None:
        with pytest.raises(StorageError, match="SQLite or PostgreSQL"):
            parse_url(storage)
    else:
        assert display_url(storage) == shown


def test_a_url_may_come_from_a_file(tmp_path: Path) -> None:
    file = tmp_path / "secret"
    file.write_text("postgresql://me:hush@host/gtf\n")

    assert parse_url(f"@{file}").password == "hush"
    assert display_url(f"@{file}") == "postgresql+psycopg://me:***@host/gtf"


@pytest.mark.parametrize(("content", "reason"), [(None, "No such file"), (b"\xff\xfe", "it is no text")])
def test_a_file_without_a_url_is_one_sentence(tmp_path: Path, content: bytes | None, reason: str) -> None:
    file = tmp_path / "secret"
    if content is not None:
        file.write_bytes(content)

    with pytest.raises(StorageError, match=rf"secret, which should hold the URL .*, cannot be read \({reason}"):
        parse_url(f"@{file}")


@pytest.mark.parametrize("storage", ["", " ", "sqlite://", "sqlite:///:memory:", "mysql://me@host/db", "http://[bad"])
def test_a_storage_that_cannot_hold_studies_is_refused(storage: str) -> None:
    with pytest.raises(StorageError):
        parse_url(storage)


def test_an_unreadable_url_is_not_repeated_in_the_message() -> None:
    with pytest.raises(StorageError) as caught:
        parse_url("postgresql://me:s3cret@host:port:5432/db")
    assert "s3cret" not in str(caught.value)


def test_passwords_are_cut_out_of_what_a_driver_says() -> None:
    url = parse_url("postgresql://me:s3cret@host/gtf?sslpassword=other")
    assert without_passwords("failed: s3cret and other", url) == "failed: *** and ***"


def test_a_home_folder_is_expanded(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("HOME", "/home/me")
    assert parse_url("~/studies.db").database == "/home/me/studies.db"
