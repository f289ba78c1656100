"""Programs are started so that nothing of them outlives a run."""

import os
import signal
import subprocess
import sys
import threading
import time
from collections.abc import Callable
from pathlib import Path

import pytest

from gtf_tune.errors import MachineError, RunError
from gtf_tune.pipelines.command import process, supervisor
from gtf_tune.pipelines.command.cuda_lock import cuda_device, cuda_lock
from gtf_tune.pipelines.command.process import ProgramExit, check_exit, run_program

pytestmark = pytest.mark.skipif(sys.platform != "linux", reason="subreapers and /proc are Linux's")

# A child that stays, and a daemon: a grandchild in a session of its own, whose parent is gone.
FAMILY = """
import os, sys, time
from pathlib import Path
def note(name):
    Path(name + ".part").write_text(str(os.getpid()))
    os.rename(name + ".part", name)
if os.fork() == 0:
    note("child")
    time.sleep(1000)
if os.fork() == 0:
    os.setsid()
    if os.fork() == 0:
        note("daemon")
        time.sleep(1000)
    os._exit(0)
note("program")
if sys.argv[1:] != ["end"]:
    time.sleep(1000)
while not (os.path.exists("child") and os.path.exists("daemon")):
    time.sleep(0.01)
"""
SUPERVISOR = Path(process.__file__).with_name("supervisor.py")
MEMBERS = ("program", "child", "daemon")


def run(folder: Path, *arguments: str, code: str = "") -> ProgramExit:
    script = folder / "program.py"
    script.write_text(code)
    return run_program([sys.executable, "-I", "-S", str(script), *arguments], folder, {}, folder / "report.json")


def wait_until(condition: Callable[[], bool], timeout_s: float = 20.0) -> None:
    deadline = time.monotonic() + timeout_s
    while not condition():
        if time.monotonic() > deadline:
            pytest.fail("timed out")
        threading.Event().wait(0.01)


def is_running(pid: int) -> bool:
    try:
        return "\nState:\tZ" not in Path(f"/proc/{pid}/status").read_text()
    except OSError:
        return False


def pids(folder: Path) -> list[int]:
    return [int((folder / name).read_text()) for name in MEMBERS]


def test_the_end_of_a_program_is_told(tmp_path: Path) -> None:
    ended = run(tmp_path, code="import sys; print('one', flush=True); print('two\\n', file=sys.stderr); sys.exit(3)")

    assert (ended.exit_code, ended.last_line) == (3, "two")
    assert ended.peak_memory_bytes > 10**6


def test_output_goes_to_the_log_of_the_run(tmp_path: Path, capfd: pytest.CaptureFixture[str]) -> None:
    run(tmp_path, code="import sys; print('out'); print('err', file=sys.stderr)")

    assert sorted(capfd.readouterr().out.split()) == ["err", "out"]


def test_descendants_of_a_program_that_ended_are_killed(tmp_path: Path) -> None:
    run(tmp_path, "end", code=FAMILY)

    assert not any(is_running(pid) for pid in pids(tmp_path))


def test_nobody_outlives_a_run_that_is_killed(tmp_path: Path) -> None:
    (tmp_path / "program.py").write_text(FAMILY)
    code = (
        "from pathlib import Path; from gtf_tune.pipelines.command.process import run_program\n"
        f"run_program([{sys.executable!r}, '-S', 'program.py'], Path({str(tmp_path)!r}), {{}}, Path('report.json'))"
    )
    worker = subprocess.Popen([sys.executable, "-c", code], cwd=tmp_path)
    try:
        wait_until(lambda: all((tmp_path / name).exists() for name in MEMBERS))
        assert all(is_running(pid) for pid in pids(tmp_path))
    finally:
        worker.send_signal(signal.SIGKILL)
        worker.wait()

    wait_until(lambda: not any(is_running(pid) for pid in pids(tmp_path)))


def test_a_program_does_not_outlive_its_supervisor(tmp_path: Path) -> None:
    code = "import os, time; open('part', 'w').write(str(os.getpid())); os.rename('part', 'pid'); time.sleep(1000)"
    words = [sys.executable, "-I", "-S", SUPERVISOR, "report.json", "1000", sys.executable, "-S", "-c", code]
    with subprocess.Popen(words, stdin=subprocess.PIPE, cwd=tmp_path) as supervisor:
        wait_until((tmp_path / "pid").exists)
        supervisor.kill()

    wait_until(lambda: not is_running(int((tmp_path / "pid").read_text())))


def test_a_flood_of_output_is_cut_in_the_middle(tmp_path: Path) -> None:
    script = "import os; [os.write(1, b'x' * 99999 + b'\\n') for _ in range(1000)]; print('the end')"
    with (tmp_path / "log").open("ab") as log:
        log.write(b"before\n")
        log.flush()
        running = subprocess.Popen(
            [sys.executable, "-I", "-S", SUPERVISOR, "report.json", str(10**6), sys.executable, "-S", "-c", script],
            stdin=subprocess.PIPE,
            stdout=log,
            cwd=tmp_path,
        )
        assert running.wait() == 0
        assert running.stdin is not None
        running.stdin.close()

    text = (tmp_path / "log").read_text()
    assert len(text) < 1.1 * 10**6
    assert text.startswith("before\nxxx")
    assert text.endswith("x\nthe end\n")
    assert "bytes of output left out" in text


def test_a_program_that_cannot_start_is_an_error_with_its_reason(tmp_path: Path) -> None:
    with pytest.raises(MachineError, match=r"cannot start /no/such/program: .*No such file"):
        run_program(["/no/such/program"], tmp_path, {}, tmp_path / "report.json")


def test_a_program_without_its_folder_is_an_error_with_its_reason(tmp_path: Path) -> None:
    with pytest.raises(MachineError, match=r"there is no folder .*nowhere to start it in; see 'working_folder'"):
        run_program([sys.executable], tmp_path / "nowhere", {}, tmp_path / "report.json")


def test_own_variables_are_withheld_and_others_passed_on(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("GTF_TUNE_STORAGE", "postgresql://user:secret@host/db")
    monkeypatch.setenv("KEPT", "1")

    code = "import os; print(os.environ.get('GTF_TUNE_STORAGE'), os.environ['KEPT'], os.environ['ADDED'])"
    (tmp_path / "program.py").write_text(code)
    ended = run_program([sys.executable, "-S", "program.py"], tmp_path, {"ADDED": "2"}, tmp_path / "report.json")

    assert ended.last_line == "None 1 2"


def test_reasons_name_exit_codes_signals_and_last_words() -> None:
    check_exit("x", ProgramExit(0, "", 0, 0.0))
    check_exit("x", ProgramExit(3, "", 0, 0.0), accepted=(0, 3))
    with pytest.raises(RunError, match=r"^x ended with exit code 3; its last words: no features$"):
        check_exit("x", ProgramExit(3, "no features", 0, 0.0))
    with pytest.raises(RunError, match=r"^x was ended by SIGSEGV$"):
        check_exit("x", ProgramExit(-signal.SIGSEGV, "", 0, 0.0))
    with pytest.raises(RunError, match=r"SIGKILL, most likely for want of memory$"):
        check_exit("x", ProgramExit(-signal.SIGKILL, "", 0, 0.0))
    with pytest.raises(RunError, match=r"signal 40$"):
        check_exit("x", ProgramExit(-40, "", 0, 0.0))


def test_a_program_at_the_memory_limit_is_said_to_be_there(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    limit_kib = 200_000
    script = "held = [bytearray(b'1') * 10**7 for _ in range(100)]"
    words = ["sh", "-c", f'ulimit -d {limit_kib}; exec "$0" -S -c "$1"', sys.executable, script]

    ended = run_program(words, tmp_path, {}, tmp_path / "report.json")

    monkeypatch.setattr(process, "memory_limit_bytes", lambda: limit_kib * 1024)
    with pytest.raises(RunError, match=r"of the 0\.2 GB that a run may have .* its last words: MemoryError"):
        check_exit("x", ended)


def test_one_run_at_a_time_has_a_device(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("tempfile.tempdir", str(tmp_path))
    order: list[str] = []

    def wait_for_device() -> None:
        with cuda_lock("0"):
            order.append("second")

    with cuda_lock("0"), cuda_lock("1"):
        waiting = threading.Thread(target=wait_for_device)
        waiting.start()
        waiting.join(0.2)
        order.append("first")
    waiting.join()

    assert order == ["first", "second"]


def test_the_device_is_the_first_that_is_visible(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.delenv("CUDA_VISIBLE_DEVICES", raising=False)
    assert cuda_device() == "0"
    monkeypatch.setenv("CUDA_VISIBLE_DEVICES", "3,1")
    assert cuda_device() == "3"
    monkeypatch.setenv("CUDA_VISIBLE_DEVICES", "../GPU-1/x")
    assert os.sep not in cuda_device()


def test_descendants_are_found_without_proc_too(monkeypatch: pytest.MonkeyPatch) -> None:
    started = subprocess.Popen(["sleep", "60"])
    try:
        found = set(supervisor._descendants())
        monkeypatch.setattr(supervisor.os.path, "isdir", lambda _: False)
        listed = set(supervisor._descendants())
    finally:
        started.kill()
        started.wait()
    assert started.pid in found
    assert found <= listed
