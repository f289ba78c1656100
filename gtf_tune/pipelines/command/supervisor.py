"""Run one program, leave none of its descendants behind, and keep its log small.

This file is run as a script by a bare interpreter (standard library only, no packages), between a run's process and
the program. Its standard input is a pipe that the run's process holds open: the kernel closes it when that process ends
in whatever way, SIGKILL included, and everything that the program has started is then killed. The supervisor is the
"subreaper" of its descendants, so that even a daemon that left its session and its parents stays its own to kill.

Usage: supervisor.py REPORT LOG_LIMIT_BYTES PROGRAM [ARGUMENT ...]
"""

import ctypes
import json
import os
import resource
import selectors
import signal
import subprocess
import sys
from collections import deque
from collections.abc import Callable, Iterator
from pathlib import Path

_PR_SET_PDEATHSIG = 1
_PR_SET_CHILD_SUBREAPER = 36
_CHUNK_BYTES = 65536
_LAST_LINE_BYTES = 300
_KIB = 1024
_HEAD_SHARE = 0.2
_TAIL_SHARE = 0.4
_CANNOT_START = 127


class CappedLog:
    """Pass output on to standard output; where that is a file, cut out the middle of what exceeds the limit."""

    def __init__(self, limit_bytes: int) -> None:
        self._start = os.fstat(1).st_size
        self._limit = limit_bytes
        self._tail_limit = int(limit_bytes * _TAIL_SHARE)
        self._chunks: deque[bytes] = deque()
        self._kept = 0
        self._in_file = 0
        self._total = 0

    def write(self, chunk: bytes) -> None:
        """Add output to the log."""
        self._total += len(chunk)
        self._keep(chunk)
        if self._in_file + len(chunk) > self._limit:
            self._cut()
        else:
            self._in_file += len(chunk)
            _write_all(chunk)

    @property
    def last_line(self) -> str:
        """Return the end of the last line that is not empty."""
        lines = self._tail()[-_CHUNK_BYTES:].decode(errors="replace").replace("\r", "\n").split("\n")
        return next((line.strip() for line in reversed(lines) if line.strip()), "")[-_LAST_LINE_BYTES:]

    def _keep(self, chunk: bytes) -> None:
        self._chunks.append(chunk)
        self._kept += len(chunk)
        while self._kept - len(self._chunks[0]) > self._tail_limit:
            self._kept -= len(self._chunks.popleft())

    def _tail(self) -> bytes:
        return b"".join(self._chunks)[-self._tail_limit :]

    def _cut(self) -> None:
        head, tail = int(self._limit * _HEAD_SHARE), self._tail()
        try:
            os.ftruncate(1, self._start + head)
            os.lseek(1, 0, os.SEEK_END)
        except OSError:
            self._in_file = self._limit
            return
        left_out = self._total - head - len(tail)
        _write_all(f"\n[... {left_out} bytes of output left out ...]\n".encode() + tail)
        self._in_file = head + len(tail)


def main(arguments: list[str]) -> int:
    """Run the program, write how it ended to the report file, and return its exit code."""
    report, log_limit, program = Path(arguments[0]), int(arguments[1]), arguments[2:]
    _become_subreaper()
    log = CappedLog(log_limit)
    try:
        process = subprocess.Popen(
            program,
            stdin=subprocess.DEVNULL,
            stdout=subprocess.PIPE,
            stderr=subprocess.STDOUT,
            start_new_session=True,
            preexec_fn=_die_with(os.getpid()),
        )
    except (OSError, ValueError) as error:
        fault = {"cannot_start": str(error), "errno": getattr(error, "errno", 0)}
        report.write_text(json.dumps(fault), encoding="utf-8")
        return _CANNOT_START
    code = _watch(process, log)
    kill_descendants()
    _drain(process, log)
    report.write_text(
        json.dumps(
            {
                "exit_code": code,
                "last_line": log.last_line,
                "peak_memory_bytes": resource.getrusage(resource.RUSAGE_CHILDREN).ru_maxrss * _KIB,
            }
        ),
        encoding="utf-8",
    )
    return code if code >= 0 else 128 - code


def kill_descendants() -> None:
    """Kill everything that has this process for an ancestor, until nothing is left."""
    while True:
        for pid in _descendants():
            try:
                os.kill(pid, signal.SIGKILL)
            except OSError:
                continue
        try:
            # The orphans of what was killed become children of this process, so this ends only with the last one.
            os.waitpid(-1, 0)
        except ChildProcessError:
            return


def _watch(process: "subprocess.Popen[bytes]", log: CappedLog) -> int:
    """Copy output until the program ends (its return code), or the other end of standard input goes (kill it)."""
    woken, wake = os.pipe()
    os.set_blocking(woken, False)
    os.set_blocking(wake, False)
    signal.set_wakeup_fd(wake)
    signal.signal(signal.SIGCHLD, lambda *_: None)
    signal.signal(signal.SIGTERM, _stop)
    selector = selectors.DefaultSelector()
    output = process.stdout
    if output is None:
        raise RuntimeError("the program was started without a pipe for its output")
    for watched in (0, woken, output.fileno()):
        selector.register(watched, selectors.EVENT_READ)
    while process.poll() is None:
        for key, _ in selector.select():
            data = os.read(key.fd, _CHUNK_BYTES)
            if key.fd == 0 and not data:
                _stop()
            elif key.fd == output.fileno():
                log.write(data)
                if not data:
                    selector.unregister(output.fileno())
    return process.returncode


def _stop(*_: object) -> None:
    kill_descendants()
    sys.exit(128 + signal.SIGTERM)


def _drain(process: "subprocess.Popen[bytes]", log: CappedLog) -> None:
    while process.stdout is not None and (data := os.read(process.stdout.fileno(), _CHUNK_BYTES)):
        log.write(data)


def _descendants() -> list[int]:
    children: dict[int, list[int]] = {}
    for pid, parent in _processes():
        children.setdefault(parent, []).append(pid)
    found, waiting = [], [os.getpid()]
    while waiting:
        of_one = children.get(waiting.pop(), [])
        found += of_one
        waiting += of_one
    return found


def _processes() -> Iterator[tuple[int, int]]:
    """Yield the number of every process and that of its parent."""
    if not os.path.isdir("/proc"):  # macOS
        listed = subprocess.run(["ps", "-A", "-o", "pid=,ppid="], capture_output=True, text=True, check=False).stdout
        yield from ((int(line.split()[0]), int(line.split()[1])) for line in listed.splitlines())
        return
    for folder in os.listdir("/proc"):
        if folder.isdigit():
            try:
                status = Path("/proc", folder, "stat").read_bytes()
            except OSError:
                continue
            # The name of the program stands in parentheses and may hold anything.
            yield int(folder), int(status.rpartition(b")")[2].split()[1])


def _become_subreaper() -> None:
    if sys.platform == "linux":
        ctypes.CDLL(None, use_errno=True).prctl(_PR_SET_CHILD_SUBREAPER, 1, 0, 0, 0)


def _die_with(parent: int) -> Callable[[], None]:
    """Return what the child does before the program starts: ask to be killed when the supervisor ends."""
    prctl = ctypes.CDLL(None, use_errno=True).prctl if sys.platform == "linux" else None

    def prepare() -> None:
        if prctl is not None:
            prctl(_PR_SET_PDEATHSIG, signal.SIGKILL, 0, 0, 0)
        if os.getppid() != parent:
            os._exit(_CANNOT_START)

    return prepare


def _write_all(data: bytes) -> None:
    while data:
        data = data[os.write(1, data) :]


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
