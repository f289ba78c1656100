"""Time a run by what it takes itself: neither while the machine sleeps nor while the run waits for others.

The process of a run notes in a small file which phase it is in: a stage that it builds, the run itself, or a wait. Who
supervises it counts short ticks towards the phase of the moment. A tick that took much longer than planned means that
the supervisor was suspended too (a laptop's lid, ``docker pause``), and counts as a planned one. Clocks that tell the
time of day, which people and NTP set, have no part in it.
"""

import contextlib
import os
from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path

import psutil

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
