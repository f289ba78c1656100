import os
import resource
import signal
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from gtf_tune.execution.paths import RunPaths
from gtf_tune.execution.process import output_to
from gtf_tune.operating_system import interrupts_withheld, memory_limited

MIB = 2**20


def test_everything_that_a_run_prints_goes_to_its_log(tmp_path: Path) -> None:
    with output_to(tmp_path / "run.log"):
        os.write(1, b"from C\n")
        subprocess.run([sys.executable, "-c", "import sys; sys.stderr.write('from a child\\n')"], check=True)

    assert (tmp_path / "run.log").read_text().splitlines() == ["from C", "from a child"]


def test_output_returns_to_where_it_went_before(tmp_path: Path, capfd: pytest.CaptureFixture[str]) -> None:
    with output_to(tmp_path / "run.log"):
        os.write(1, b"inside\n")
    with pytest.raises(OSError), output_to(tmp_path / "run.log"):  # noqa: PT011 (what is raised is not the point)
        os.close(-1)
    os.write(1, b"outside\n")

    assert capfd.readouterr().out == "outside\n"
    assert (tmp_path / "run.log").read_text() == "inside\n"


def test_a_run_cannot_take_more_memory_than_its_limit() -> None:
    with memory_limited(64 * MIB), pytest.raises(MemoryError):
        np.ones(128 * MIB // 8)

    assert np.ones(128 * MIB // 8).nbytes == 128 * MIB


def test_memory_inside_the_limit_is_given() -> None:
    with memory_limited(256 * MIB):
        assert np.ones(32 * MIB // 8).nbytes == 32 * MIB


def test_limits_end_with_the_run() -> None:
    before = resource.getrlimit(resource.RLIMIT_DATA)

    with memory_limited(64 * MIB):
        assert resource.getrlimit(resource.RLIMIT_DATA) != before

    assert resource.getrlimit(resource.RLIMIT_DATA) == before


@pytest.mark.skipif(sys.platform != "linux", reason="only Linux can start the measurement anew")
def test_the_peak_is_that_of_the_run_and_not_of_earlier_ones() -> None:
    code = """
import numpy as np
from gtf_tune.operating_system import peak_memory_bytes, reset_peak_memory
np.ones(256 * 2**20 // 8)
reset_peak_memory()
quiet = peak_memory_bytes()
np.ones(64 * 2**20 // 8)
print(peak_memory_bytes() - quiet)
"""
    done = subprocess.run([sys.executable, "-c", code], check=True, capture_output=True, text=True)

    assert 48 * MIB < int(done.stdout) < 128 * MIB


def test_only_the_tail_of_a_long_log_is_read(tmp_path: Path) -> None:
    paths = RunPaths(tmp_path / "run")
    paths.create()
    paths.log.write_bytes(b"start" + b"x" * 20_000 + b"\x00\xff end")

    tail = paths.read_log_tail()

    assert len(tail) <= 8192
    assert tail.endswith(" end")
    assert "start" not in tail
    assert "\x00" not in tail


def test_a_missing_log_is_empty(tmp_path: Path) -> None:
    assert RunPaths(tmp_path / "never").read_log_tail() == ""


def test_ctrl_c_is_withheld_from_what_starts_and_heard_again_afterwards_also_after_an_error() -> None:
    def withheld() -> bool:
        return signal.SIGINT in signal.pthread_sigmask(signal.SIG_BLOCK, [])

    with interrupts_withheld():
        inside = withheld()
    with pytest.raises(ZeroDivisionError), interrupts_withheld():
        _ = 1 / 0

    assert (inside, withheld()) == (True, False)


def test_what_withholds_ctrl_c_holds_also_for_the_first_process_of_all() -> None:
    script = (
        "import signal, multiprocessing\n"
        "from gtf_tune.operating_system import interrupts_withheld\n"
        "with interrupts_withheld():\n"
        "    multiprocessing.get_context('spawn').Lock()\n"
        "    print(signal.SIGINT in signal.pthread_sigmask(signal.SIG_BLOCK, []))\n"
    )

    said = subprocess.run([sys.executable, "-c", script], capture_output=True, text=True, check=True).stdout

    assert said == "True\n"
