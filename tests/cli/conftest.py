"""Call the command line in this process, as the installed script does."""

import sys
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import pytest

import gtf_tune.execution
from gtf_tune.cli.main import main
from gtf_tune.execution import InlineExecutor
from gtf_tune.report.dashboard import notes
from tests.study.conftest import write_sequence


@dataclass(frozen=True)
class Said:
    """What a command printed and its exit code."""

    code: int
    out: str
    err: str


Cli = Callable[..., Said]


@pytest.fixture(autouse=True)
def _quick(request: pytest.FixtureRequest, copied_tables: None, monkeypatch: pytest.MonkeyPatch) -> None:
    """Run in this process and draw nothing for optuna-dashboard, except in tests marked ``real_runs`` or ``drawn``."""
    if not request.node.get_closest_marker("real_runs"):
        monkeypatch.setattr(gtf_tune.execution, "LocalExecutor", lambda *_, **__: InlineExecutor())
    if not request.node.get_closest_marker("drawn"):
        monkeypatch.setattr(notes, "key_figures", lambda _: [])


@pytest.fixture
def cli(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capfd: pytest.CaptureFixture[str]) -> Cli:
    """Run a command in an empty folder."""
    monkeypatch.chdir(tmp_path)

    def call(*arguments: str) -> Said:
        monkeypatch.setattr(sys, "argv", ["gtf-tune", *arguments])
        capfd.readouterr()
        try:
            main()
            code = 0
        except SystemExit as exit_:
            code = int(exit_.code or 0)
        printed = capfd.readouterr()
        return Said(code, printed.out, printed.err)

    return call


@pytest.fixture
def room(tmp_path: Path) -> Path:
    return write_sequence(tmp_path / "room", ground_truth=True)
