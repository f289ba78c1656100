"""Keep tests away from the user's cache and settings."""

from pathlib import Path

import pytest


@pytest.fixture(autouse=True)
def _own_environment(tmp_path_factory: pytest.TempPathFactory, monkeypatch: pytest.MonkeyPatch) -> None:
    cache: Path = tmp_path_factory.getbasetemp() / "cache"
    monkeypatch.setenv("GTF_TUNE_CACHE_DIR", str(cache))
    monkeypatch.delenv("GTF_TUNE_STORAGE", raising=False)
