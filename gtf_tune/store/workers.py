"""Tell which process works on a trial, and whether it still lives."""

import os
import socket
from dataclasses import dataclass
from pathlib import Path

_DEAD_STATES = frozenset("ZXx")
_STATE_FIELD = 0
_START_FIELD = 19


@dataclass(frozen=True)
class Worker:
    """Identify one process.

    ``machine`` names one boot of one machine and one process namespace, so that process numbers are only compared where
    they mean the same. ``pid_started`` counts clock ticks since that boot, which no change of the clock moves.
    """

    name: str
    host: str
    machine: str
    pid: int
    pid_started: int


def this_worker(name: str = "") -> Worker:
    """Return the worker that this process is; the name defaults to ``HOST:PID``."""
    host, pid = socket.gethostname(), os.getpid()
    return Worker(name or f"{host}:{pid}", host, _machine(host), pid, _start_of(pid) or 0)


def has_died(worker: Worker) -> bool:
    """Tell whether a worker's process is known to be gone; false where this machine cannot know."""
    if worker.machine != _machine(socket.gethostname()):
        return False
    return _start_of(worker.pid) != worker.pid_started


def _machine(host: str) -> str:
    boot = Path("/proc/sys/kernel/random/boot_id").read_text(encoding="ascii").strip()
    return f"{host} {boot} {os.readlink('/proc/self/ns/pid')}"


def _start_of(pid: int) -> int | None:
    """Return when a process started, or None where no such process lives."""
    try:
        status = Path(f"/proc/{pid}/stat").read_text(encoding="utf-8", errors="replace")
    except (FileNotFoundError, ProcessLookupError):
        return None
    # proc(5): the name in brackets may itself hold brackets and spaces, so the fields count from the last bracket.
    fields = status.rpartition(")")[2].split()
    return None if fields[_STATE_FIELD] in _DEAD_STATES else int(fields[_START_FIELD])
