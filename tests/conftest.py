"""Keep tests away from the user's cache and settings, and from chance and the clock."""

import sqlite3
from collections.abc import Iterator
from contextlib import closing
from pathlib import Path
from typing import Any

import pytest
from hypothesis import HealthCheck, settings

# The same examples everywhere, however slow the machine: elsewhere Hypothesis draws others each time, and fails an
# example of more than 0.2 s.
settings.register_profile(
    "steady", derandomize=True, deadline=None, database=None, suppress_health_check=[HealthCheck.too_slow]
)
settings.load_profile("steady")


# What an environment may hold that changes where commands write and how their tables look.
UNWANTED = (
    "GTF_TUNE_STORAGE",
    "GTF_TUNE_DATA_ROOT",
    "FORCE_COLOR",
    "NO_COLOR",
    "PY_COLORS",
    "GITHUB_ACTIONS",
    "TERMINAL_WIDTH",
    "TTY_COMPATIBLE",
)


@pytest.fixture(scope="session", autouse=True)
def _own_environment(tmp_path_factory: pytest.TempPathFactory) -> Iterator[None]:
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("GTF_TUNE_CACHE_DIR", str(tmp_path_factory.getbasetemp() / "cache"))
        patch.setenv("COLUMNS", "80")
        for name in UNWANTED:
            patch.delenv(name, raising=False)
        yield


@pytest.fixture(scope="session")
def sqlite_template(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return a SQLite file with all tables and nothing in them, to be copied: making them takes a third of a second."""
    from gtf_tune.store.database import create_database

    path = tmp_path_factory.mktemp("template") / "empty.db"
    create_database(str(path)).close()
    return path


@pytest.fixture
def copied_tables(sqlite_template: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Let new SQLite files get their tables from `sqlite_template`; how they are made is tested in tests/store."""
    from gtf_tune.store.database import handle

    make = handle.create_schema

    def copy(engine: Any, url: Any) -> None:
        if url.get_backend_name() != "sqlite":
            make(engine, url)
            return
        with closing(sqlite3.connect(str(url.database))) as target, closing(sqlite3.connect(sqlite_template)) as source:
            if target.execute("SELECT * FROM sqlite_master").fetchall():
                make(engine, url)
            else:
                source.backup(target)

    monkeypatch.setattr(handle, "create_schema", copy)
