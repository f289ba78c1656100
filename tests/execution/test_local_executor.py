import errno
import shutil
import signal
import subprocess
import sys
import threading
from collections.abc import Iterator
from concurrent.futures import CancelledError, Future, ThreadPoolExecutor
from contextlib import suppress
from pathlib import Path

import psutil
import pytest

from gtf_tune.errors import MachineError
from gtf_tune.execution import Executor, LocalExecutor, workers
from gtf_tune.execution.paths import Scratch
from gtf_tune.pipelines.run import RunOutcome
from tests.execution.doubles import Hanging, Listening, Refusing, analytic, request_of
from tests.execution.executor_contract import LIMITS, WAIT_S, ExecutorContract, outcome_of

HANGING_PARENT = """
import sys
from pathlib import Path
from gtf_tune.execution import LocalExecutor, RunLimits
from tests.execution.doubles import Hanging, request_of

if __name__ == "__main__":
    folder = Path(sys.argv[1])
    with LocalExecutor(jobs=1, scratch=folder / "scratch") as executor:
        future = executor.submit(request_of(Hanging(folder / "pid")), RunLimits(600.0, 2**30))
        print("started", flush=True)
        future.result()
"""


@pytest.fixture(scope="module")
def executor(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Executor]:
    with LocalExecutor(jobs=2, scratch=tmp_path_factory.mktemp("scratch")) as executor:
        yield executor


class TestLocalExecutor(ExecutorContract):
    """Check the promises of every executor."""


def test_nothing_more_is_run_where_another_run_succeeds_after_the_failure(executor: Executor, tmp_path: Path) -> None:
    pipeline = Refusing(tmp_path / "note", name="refusing, then not", pause_s=0.5)
    known_good = request_of(pipeline, 0)

    futures = [executor.submit(request_of(pipeline, index), LIMITS, known_good) for index in (1, 2, 3, 0)]
    outcomes = [future.result(WAIT_S) for future in futures]

    assert [outcome.status for outcome in outcomes] == ["failed", "failed", "failed", "ok"]
    assert sorted((tmp_path / "note.runs").read_text().split()) == ["0", "1", "2", "3"]


@pytest.fixture
def hanging(tmp_path: Path) -> Hanging:
    return Hanging(tmp_path / "pid")


def _workers() -> list[psutil.Process]:
    found = []
    for child in psutil.Process().children():
        with suppress(psutil.NoSuchProcess):  # what other tests started may end this very moment
            if "spawn_main" in " ".join(child.cmdline()):
                found.append(child)
    return found


def test_runs_go_side_by_side_up_to_the_number_of_jobs(tmp_path: Path, hanging: Hanging) -> None:
    with LocalExecutor(jobs=2, scratch=tmp_path / "scratch") as executor:
        futures = [executor.submit(request_of(hanging, index), LIMITS) for index in range(3)]

        assert [future.running() for future in futures] == [True, True, False]


def test_a_run_waits_until_the_memory_that_its_kind_needs_is_there(tmp_path: Path, hanging: Hanging) -> None:
    hanging.name = "analytic"
    with LocalExecutor(jobs=2, scratch=tmp_path / "scratch", memory_bytes=2**20) as executor:
        outcome_of(executor, analytic())  # tells the executor what a run of this kind takes
        futures = [executor.submit(request_of(hanging, index), LIMITS) for index in range(2)]

        assert [future.running() for future in futures] == [True, False]


@pytest.mark.parametrize("victims", [1, 2])
def test_the_death_of_idle_workers_harms_nobody(tmp_path: Path, victims: int) -> None:
    others = set(_workers())
    with LocalExecutor(jobs=2, scratch=tmp_path / "scratch") as executor:
        for future in [executor.submit(request_of(analytic(), index), LIMITS) for index in range(2)]:
            future.result(WAIT_S)
        for worker in list(set(_workers()) - others)[:victims]:
            worker.kill()

        outcomes = [executor.submit(request_of(analytic(), index), LIMITS) for index in range(4)]

        assert [outcome.result(WAIT_S).status for outcome in outcomes] == ["ok"] * 4


def test_waiting_runs_can_be_cancelled(tmp_path: Path, hanging: Hanging) -> None:
    with LocalExecutor(jobs=1, scratch=tmp_path / "scratch") as executor:
        futures = [executor.submit(request_of(hanging, index), LIMITS) for index in range(3)]
        executor.cancel_waiting()

        assert [future.cancelled() for future in futures] == [False, True, True]


def test_leaving_the_executor_ends_every_run_and_removes_every_file(tmp_path: Path, hanging: Hanging) -> None:
    before = set(_workers())
    with LocalExecutor(jobs=1, scratch=tmp_path / "scratch") as executor:
        future = executor.submit(request_of(hanging), LIMITS)

    with pytest.raises(CancelledError):
        future.result(WAIT_S)
    assert list((tmp_path / "scratch").glob("runs-*")) == []
    assert set(_workers()) <= before


def test_workers_die_with_a_parent_that_was_killed(tmp_path: Path) -> None:
    script = tmp_path / "parent.py"
    script.write_text(HANGING_PARENT)
    root = Path(__file__).parents[2]
    parent = subprocess.Popen(
        [sys.executable, str(script), str(tmp_path)], stdout=subprocess.PIPE, env={"PYTHONPATH": str(root)}, cwd=root
    )
    assert parent.stdout is not None
    assert parent.stdout.readline() == b"started\n"
    workers = psutil.Process(parent.pid).children(recursive=True)

    parent.kill()
    parent.communicate()

    assert workers
    assert psutil.wait_procs(workers, timeout=WAIT_S)[1] == []


def _hears_interrupts(process: psutil.Process) -> bool:
    lines = Path(f"/proc/{process.pid}/status").read_text().splitlines()
    masks = dict(line.split(":\t") for line in lines if line.startswith(("SigBlk", "SigIgn")))
    return not any(int(mask, 16) >> (signal.SIGINT - 1) & 1 for mask in masks.values())


@pytest.mark.skipif(sys.platform != "linux", reason="only Linux tells the signals of another process")
def test_a_process_that_only_just_starts_leaves_ctrl_c_to_its_parent(tmp_path: Path, hanging: Hanging) -> None:
    others = set(_workers())
    with LocalExecutor(jobs=2, scratch=tmp_path / "scratch") as executor:
        for index in range(2):
            executor.submit(request_of(hanging, index), LIMITS)
        heard = [_hears_interrupts(worker) for worker in set(_workers()) - others]

    assert heard == [False, False]
    assert signal.SIGINT not in signal.pthread_sigmask(signal.SIG_BLOCK, [])


def test_ctrl_c_is_ignored_but_not_withheld_once_a_run_begins(tmp_path: Path) -> None:
    with LocalExecutor(jobs=1, scratch=tmp_path / "scratch") as executor:
        outcome_of(executor, Listening(tmp_path / "note"))

    assert (tmp_path / "note").read_text() == "ignored=True withheld=False"


def test_the_files_of_a_killed_executor_are_removed_by_the_next_one(tmp_path: Path) -> None:
    living = Scratch(tmp_path)
    dead = Scratch(tmp_path)
    (dead.folder / "left").write_text("over")
    dead._lock.close()  # what the kernel does to a killed process

    Scratch(tmp_path).close()

    assert living.folder.exists()
    assert not dead.folder.exists()
    living.close()


def test_executors_that_start_at_once_leave_each_others_files_alone(tmp_path: Path) -> None:
    start = threading.Barrier(8)

    def begin(_: int) -> Scratch:
        start.wait()
        return Scratch(tmp_path)

    for _ in range(25):
        with ThreadPoolExecutor(8) as pool:
            made = list(pool.map(begin, range(8)))
        assert all(one.folder.exists() for one in made)
        for one in made:
            one.close()


def test_a_folder_whose_owner_was_killed_before_it_locked_it_is_removed(tmp_path: Path) -> None:
    (tmp_path / "runs-unlocked").mkdir()

    Scratch(tmp_path).close()

    assert not (tmp_path / "runs-unlocked").exists()


def test_a_place_that_cannot_be_written_to_is_one_sentence(tmp_path: Path) -> None:
    (tmp_path / "file").write_text("in the way")

    with pytest.raises(MachineError, match="choose another folder for the cache"):
        LocalExecutor(scratch=tmp_path / "file" / "scratch")


def test_runs_whose_folder_is_taken_away_are_failures_of_the_machine(tmp_path: Path) -> None:
    with LocalExecutor(jobs=1, scratch=tmp_path / "scratch") as executor:
        futures = [executor.submit(request_of(analytic(), index), LIMITS) for index in range(3)]
        shutil.rmtree(executor._scratch.folder)

        outcomes = [future.result(timeout=WAIT_S) for future in futures]

    assert {(outcome.status, outcome.cause) for outcome in outcomes} == {("failed", "machine")}
    assert all("choose another folder for the cache" in outcome.error for outcome in outcomes)


class ForgetfulPool:
    """Behave like a pool whose process was killed between the check that it lives and the arrival of the run."""

    def __init__(self) -> None:
        self.looks = 0

    @property
    def active(self) -> bool:
        self.looks += 1
        return self.looks == 1

    def schedule(self, *arguments: object, **named: object) -> "Future[RunOutcome]":
        return Future()

    def stop(self) -> None:
        pass

    def join(self) -> None:
        pass


def test_a_run_that_its_pool_forgets_is_tried_again(tmp_path: Path) -> None:
    with LocalExecutor(1, scratch=tmp_path) as executor:
        executor._workers._idle.append(ForgetfulPool())  # type: ignore[arg-type]
        outcome = executor.submit(request_of(analytic()), LIMITS).result(timeout=WAIT_S)

    assert outcome.status == "ok"


def test_a_machine_that_can_start_no_process_says_so(monkeypatch: pytest.MonkeyPatch) -> None:
    class Refused:
        """A pool as under ``ulimit -n 20``."""

        def __init__(self, **_: object) -> None: ...

        @property
        def active(self) -> bool:
            raise OSError(errno.EMFILE, "Too many open files")

        def stop(self) -> None:
            raise RuntimeError("never started")

    monkeypatch.setattr(workers, "ProcessPool", Refused)
    lent = workers.Workers()

    with pytest.raises(MachineError, match=r"cannot start another process; .* raise its limits"):
        lent.take()
    lent.close()
