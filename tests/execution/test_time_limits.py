"""The time limit of a run counts what the run itself takes, and nothing that the machine does meanwhile."""

import os
import signal
import subprocess
import sys
import time
from collections.abc import Iterator
from pathlib import Path

import psutil
import pytest

from gtf_tune.execution import LocalExecutor, RunLimits, StageCache
from gtf_tune.pipelines import RunOutcome
from tests.execution.doubles import Slow, request_of

WAIT_S = 60.0
GIB = 2**30

SLOW_RUN = """
import sys
from pathlib import Path
from gtf_tune.execution import LocalExecutor, RunLimits
from tests.execution.doubles import Slow, request_of

if __name__ == "__main__":
    folder = Path(sys.argv[1])
    with LocalExecutor(jobs=1, scratch=folder / "scratch") as executor:
        future = executor.submit(request_of(Slow(folder / "note", run_s=1.0)), RunLimits(2.0, 2**30))
        outcome = future.result()
        print(outcome.status, outcome.error)
"""


@pytest.fixture
def executor(tmp_path: Path) -> Iterator[LocalExecutor]:
    with LocalExecutor(2, StageCache(tmp_path / "cache"), scratch=tmp_path / "scratch") as executor:
        yield executor


def outcomes(executor: LocalExecutor, pipeline: Slow, limit_s: float, runs: int = 1) -> list[RunOutcome]:
    limits = RunLimits(limit_s, GIB)
    futures = [executor.submit(request_of(pipeline, index), limits) for index in range(runs)]
    return [future.result(WAIT_S) for future in futures]


def test_a_clock_that_is_set_forward_ends_no_run(
    executor: LocalExecutor, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    real, note = time.time, tmp_path / "note"
    future = executor.submit(request_of(Slow(note, run_s=1.5)), RunLimits(10.0, GIB))
    while not note.exists():
        time.sleep(0.01)
    monkeypatch.setattr(time, "time", lambda: real() + 900.0)

    assert future.result(WAIT_S).error == ""


def test_a_run_that_was_frozen_with_all_around_it_for_longer_than_its_limit_goes_on(tmp_path: Path) -> None:
    script, root = tmp_path / "parent.py", Path(__file__).parents[2]
    script.write_text(SLOW_RUN)
    parent = subprocess.Popen(
        [sys.executable, str(script), str(tmp_path)], stdout=subprocess.PIPE, env={"PYTHONPATH": str(root)}, cwd=root
    )
    while not (tmp_path / "note").exists():
        time.sleep(0.01)
    tree = [psutil.Process(parent.pid), *psutil.Process(parent.pid).children(recursive=True)]
    for process in tree:
        os.kill(process.pid, signal.SIGSTOP)
    time.sleep(3.0)
    for process in reversed(tree):
        os.kill(process.pid, signal.SIGCONT)

    said, _ = parent.communicate(timeout=WAIT_S)

    assert said == b"ok \n"


@pytest.mark.parametrize("cache", ["cold", "warm"])
def test_the_stages_that_a_run_waits_for_do_not_count(executor: LocalExecutor, tmp_path: Path, cache: str) -> None:
    pipeline = Slow(tmp_path / "note", stage_s=1.2, run_s=1.0)
    if cache == "warm":
        outcomes(executor, pipeline, limit_s=60.0)

    found = outcomes(executor, pipeline, limit_s=2.0, runs=2)

    assert [one.error for one in found] == ["", ""]


def test_a_stage_has_the_limit_of_a_run_for_itself(executor: LocalExecutor, tmp_path: Path) -> None:
    (found,) = outcomes(executor, Slow(tmp_path / "note", stage_s=60.0), limit_s=0.5)

    assert "no result within 0.5 s (limits.run_timeout_s), in stage 'slow'" in found.error


def test_a_run_that_takes_too_long_itself_is_ended(executor: LocalExecutor, tmp_path: Path) -> None:
    (found,) = outcomes(executor, Slow(tmp_path / "note", run_s=60.0), limit_s=0.5)

    assert found.error == "no result within 0.5 s (limits.run_timeout_s)"
