"""Python programs that run studies: quick runs in this process, and a sequence without images worth the name."""

from collections.abc import Iterator
from pathlib import Path

import pytest

from gtf_tune.api import studies, study
from gtf_tune.execution import InlineExecutor
from tests.study.conftest import write_sequence


@pytest.fixture(autouse=True)
def _copied_tables(copied_tables: None) -> None:
    """Make no tables anew."""


@pytest.fixture
def here(monkeypatch: pytest.MonkeyPatch) -> list[InlineExecutor]:
    """Let runs happen in this process, and return the executors that did them."""
    used: list[InlineExecutor] = []

    def executor_here(jobs: int | None) -> InlineExecutor:
        del jobs
        used.append(InlineExecutor())
        return used[-1]

    for module in (studies, study):
        monkeypatch.setattr(module, "executor_here", executor_here)
    return used


@pytest.fixture
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[Path]:
    """The current folder, with a sequence ``photos`` of 12 images."""
    write_sequence(tmp_path / "photos", ground_truth=False)
    monkeypatch.chdir(tmp_path)
    monkeypatch.delenv("GTF_TUNE_STORAGE", raising=False)
    return tmp_path
