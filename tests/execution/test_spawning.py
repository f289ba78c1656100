"""Child processes leave the main module of their parent alone."""

import subprocess
import sys
from pathlib import Path

import pytest

from gtf_tune.errors import DefinitionError
from gtf_tune.execution import LocalExecutor
from tests.execution.doubles import analytic, request_of
from tests.execution.executor_contract import LIMITS

UNGUARDED = """
import sys
print("main", __name__)
from gtf_tune.execution import LocalExecutor, RunLimits
from gtf_tune.pipelines import RunRequest, create_pipeline
from gtf_tune.pipelines.analytic import imaginary_sequence

request = RunRequest(create_pipeline("analytic"), {}, imaginary_sequence(12), "clean", 0, 0.0, 0, 0)
with LocalExecutor(1) as executor:
    print(executor.submit(request, RunLimits(60.0, 2**30)).result(60).status)
"""


def output_of(arguments: list[str], stdin: str = "") -> list[str]:
    done = subprocess.run([sys.executable, *arguments], input=stdin, capture_output=True, text=True, timeout=120)
    assert done.returncode == 0, done.stderr
    return done.stdout.split("\n")[:-1]


def test_a_script_needs_no_guard(tmp_path: Path) -> None:
    (tmp_path / "script.py").write_text(UNGUARDED)

    assert output_of([str(tmp_path / "script.py")]) == ["main __main__", "ok"]


def test_a_program_from_standard_input_works() -> None:
    assert output_of([], UNGUARDED) == ["main __main__", "ok"]


def test_a_module_that_is_run_needs_no_guard(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (tmp_path / "unguarded_module.py").write_text(UNGUARDED)
    monkeypatch.chdir(tmp_path)

    assert output_of(["-m", "unguarded_module"]) == ["main __main__", "ok"]


def test_a_pipeline_class_of_the_main_script_is_refused() -> None:
    class Mine(type(analytic())):  # type: ignore[misc]
        pass

    Mine.__module__ = "__main__"

    with LocalExecutor() as executor, pytest.raises(DefinitionError, match="defined in the main script"):
        executor.submit(request_of(Mine("mine", "1", {})), LIMITS)
