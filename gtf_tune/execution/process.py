"""Set up, limit and measure the process that a run lives in."""

import contextlib
import multiprocessing
import os
import signal
import subprocess
import sys
import threading
from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path

import psutil

from gtf_tune.errors import MachineError
from gtf_tune.operating_system import SIGKILL, SIGNALS_FROM_OUTSIDE, end_group, ignore_interrupts
from gtf_tune.pipelines.run import FailureCause

_WATCHDOG = Path(__file__).with_name("watchdog.py")


def initialise_worker() -> None:
    """Prepare a worker process: it and all that its runs start end with its parent, and it leaves Ctrl-C to it."""
    ignore_interrupts()
    signal.signal(signal.SIGTERM, signal.SIG_DFL)
    os.environ["OMP_NUM_THREADS"] = "1"
    if hasattr(os, "setpgid"):
        os.setpgid(0, 0)
    if hasattr(os, "pidfd_open"):
        _set_watchdog()
    else:
        threading.Thread(target=_end_with_parent, name="end-with-parent", daemon=True).start()


def _end_with_parent() -> None:
    """End this process, and what its runs have started where there are groups of processes, when its parent is gone."""
    parent = multiprocessing.parent_process()
    if parent is not None:
        parent.join()
        end_group()


def _set_watchdog() -> None:
    """Start a process that kills this process's group when it or its parent is gone (Linux; see `watchdog`).

    PR_SET_PDEATHSIG would be simpler, but it fires when the *thread* ends that started this process.
    """
    parent = multiprocessing.parent_process()
    if parent is None or parent.pid is None:
        return
    try:
        watched = [os.pidfd_open(parent.pid), os.pidfd_open(os.getpid())]
    except ProcessLookupError:
        os._exit(1)
    subprocess.Popen(
        [sys.executable, "-I", "-S", str(_WATCHDOG), str(os.getpgid(0)), *map(str, watched)],
        stdin=subprocess.DEVNULL,
        stdout=subprocess.DEVNULL,
        stderr=subprocess.DEVNULL,
        pass_fds=watched,
        start_new_session=True,
        cwd="/",
    )
    for descriptor in watched:
        os.close(descriptor)


@contextlib.contextmanager
def output_to(path: Path) -> Iterator[None]:
    """Send everything that the process writes to stdout and stderr, C++ libraries included, to a file.

    Raises
    ------
    MachineError
        The file cannot be written.
    """
    try:
        file = os.open(path, os.O_WRONLY | os.O_CREAT | os.O_APPEND, 0o644)
    except OSError as error:
        raise MachineError(
            f"cannot write {path} ({error.strerror}); choose another folder for the cache", remedy=("cache folder",)
        ) from error
    sys.stdout.flush()
    sys.stderr.flush()
    saved = [os.dup(1), os.dup(2)]
    try:
        os.dup2(file, 1)
        os.dup2(file, 2)
        yield
    finally:
        with contextlib.suppress(OSError):  # a full disk takes no more of the log
            sys.stdout.flush()
            sys.stderr.flush()
        os.dup2(saved[0], 1)
        os.dup2(saved[1], 2)
        for descriptor in (*saved, file):
            os.close(descriptor)


def cause_of_death(number: int) -> FailureCause:
    """Return what the end of a process by a signal says about its run; 0 is no signal."""
    if number == SIGKILL:
        return "killed"
    return "terminated" if number in SIGNALS_FROM_OUTSIDE else "unknown"


TICK_S = 0.25
_LONGEST_TICK_S = 2.0
_NOTE_BYTES = 256
_BUSY_SHARE = 0.8

_LONGEST_START_S = 120.0

STARTING = "the start of its process"
_RUN = ""
_WAITING = "waiting for others"


def counted(elapsed_s: float) -> float:
    """Return what a tick counts that took ``elapsed_s``."""
    return elapsed_s if elapsed_s <= _LONGEST_TICK_S else TICK_S


class PhaseNote:
    """Note the phase of this process's run in a file; ``stage`` and ``waiting`` may be nested."""

    def __init__(self, path: Path) -> None:
        self._path = path
        self._phase = _RUN
        self._write()

    def stage(self, name: str) -> contextlib.AbstractContextManager[None]:
        """Count the time until the context ends to a stage, which has the run's limit for itself."""
        return self._during(name)

    def waiting(self) -> contextlib.AbstractContextManager[None]:
        """Count the time until the context ends to nothing."""
        return self._during(_WAITING)

    @contextlib.contextmanager
    def _during(self, phase: str) -> Iterator[None]:
        before, self._phase = self._phase, phase
        self._write()
        try:
            yield
        finally:
            self._phase = before
            self._write()

    def _write(self) -> None:
        # In place and of one length: a full disk still takes it, and a reader never sees half of it.
        text = f"{os.getpid()}\n{self._phase}".encode()[:_NOTE_BYTES].ljust(_NOTE_BYTES, b"\0")
        with contextlib.suppress(OSError):
            file = os.open(self._path, os.O_WRONLY | os.O_CREAT, 0o600)
            try:
                os.write(file, text)
            finally:
                os.close(file)


@dataclass
class RunTimer:
    """Seconds that a run has used by phase, as its supervisor counts them; ``path`` is the file of its `PhaseNote`."""

    path: Path
    used_s: dict[str, float] = field(default_factory=dict)
    _pid: int = 0
    _cpu_before_s: float = 0.0

    def count(self, seconds: float) -> None:
        """Count a tick towards the phase of the moment."""
        pid, phase = self._read()
        if pid != self._pid:
            self._pid, self._cpu_before_s = pid, _cpu_s(pid)
        if phase != _WAITING:
            self.used_s[phase] = self.used_s.get(phase, 0.0) + seconds

    def overdue(self, limit_s: float) -> str | None:
        """Return the name of the phase that took longer than the limit (empty: the run itself), else ``None``.

        The start of a process, which imports what the pipeline needs, happens once for many runs and has 120 s.
        """
        start_s = max(limit_s, _LONGEST_START_S)
        limits = {phase: start_s if phase == STARTING else limit_s for phase in self.used_s}
        return next((phase for phase, used_s in self.used_s.items() if used_s > limits[phase]), None)

    def was_busy(self) -> bool:
        """Whether the run computed nearly all the time, so that it would take as long again."""
        return _cpu_s(self._pid) - self._cpu_before_s > _BUSY_SHARE * sum(self.used_s.values())

    def _read(self) -> tuple[int, str]:
        try:
            pid, _, phase = self.path.read_bytes().rstrip(b"\0").decode(errors="replace").partition("\n")
            return int(pid), phase
        except (OSError, ValueError):
            return 0, STARTING


def _cpu_s(pid: int) -> float:
    """Return the processor time of a process, its living descendants and its dead children; 0 where it is gone."""
    total = 0.0
    with contextlib.suppress(psutil.Error):
        process = psutil.Process(pid) if pid else None
        for child in [process, *process.children(recursive=True)] if process else []:
            times = child.cpu_times()
            total += times.user + times.system + times.children_user + times.children_system
    return total
