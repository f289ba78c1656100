"""The Python that the documentation shows runs as it stands."""

import runpy
import shutil
from pathlib import Path

import pytest

from tests.docs.conftest import Command
from tests.docs.pages import ROOT, Snippet, of_kind

PAGES = (ROOT / "README.md", ROOT / "docs" / "python-api.md", ROOT / "docs" / "optuna-users.md")


@pytest.mark.parametrize("shown", of_kind("python", PAGES), ids=str)
def test_an_example_runs_and_prints(
    shown: Snippet,
    call: Command,
    material: Path,
    finished: Path,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    shutil.copytree(finished if "open_study" in shown.text else material, tmp_path, dirs_exist_ok=True)
    monkeypatch.chdir(tmp_path)
    (tmp_path / "example.py").write_text(shown.text)

    runpy.run_path(str(tmp_path / "example.py"), run_name="__main__")

    assert capsys.readouterr().out.strip() or shown.text.strip() == "import gtf_tune as gtf"


def test_the_python_page_has_examples() -> None:
    assert len(of_kind("python", PAGES)) >= 6


@pytest.mark.parametrize("shown", of_kind("python"), ids=str)
def test_every_example_is_valid_python(shown: Snippet) -> None:
    compile(shown.text, str(shown), "exec")
