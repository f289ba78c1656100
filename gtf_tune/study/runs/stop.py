"""Stop a study on request: once to finish the runs in flight, twice to stop at once."""

import contextlib
import os
import signal
import threading
from collections.abc import Callable, Iterator
from types import FrameType

FINISH_RUNS = 1
STOP_NOW = 2
_INTERRUPTED_EXIT_CODE = 130
_LAST_MOMENT_S = 2.5
_LONGEST_WAIT_S = 2.0


class StopRequest:
    """How urgently someone asked to stop; may be set from signal handlers and other threads.

    A request with a parent is at least as urgent as its parent, but not the other way round: one study of a worker, or
    one trial of a study, can be asked to stop alone.
    """

    def __init__(self, parent: "StopRequest | None" = None) -> None:
        self._level = 0
        self._event = threading.Event()
        self._parent = parent

    @property
    def level(self) -> int:
        """Return 0 (go on), `FINISH_RUNS` or `STOP_NOW`."""
        return max(self._level, self._parent.level) if self._parent else self._level

    def ask(self, level: int) -> None:
        """Ask to stop, at least as urgently as ``level``."""
        self._level = max(self._level, level)
        self._event.set()

    def wait(self, timeout_s: float) -> bool:
        """Wait until someone asks to stop, and return whether someone has; ends early for the outermost request."""
        (self._parent or self)._wait(timeout_s)
        return self.level > 0

    def _wait(self, timeout_s: float) -> None:
        if self._parent is None:
            self._event.wait(timeout_s)
        else:
            self._parent._wait(timeout_s)


@contextlib.contextmanager
def signals_to(stop: StopRequest, announce: Callable[[str], None], grace_s: float = 6.0) -> Iterator[None]:
    """Turn Ctrl-C and SIGTERM into stop requests for the length of a context.

    The first Ctrl-C asks to finish the runs in flight, the second to stop at once. SIGTERM asks to finish them and
    gives them ``grace_s`` seconds, because a pre-empted machine disappears soon after; a process that then still waits
    for something, such as a database out of reach, is ended 2.5 s later: others adopt its trial when they miss its
    heartbeat.
    """

    def on_interrupt(number: int, frame: FrameType | None) -> None:
        del number, frame
        if stop.level:
            stop.ask(STOP_NOW)
            announce("stopping now; finished runs are kept")
        else:
            stop.ask(FINISH_RUNS)
            announce("finishing the runs in flight; press Ctrl-C again to stop now")

    def on_terminate(number: int, frame: FrameType | None) -> None:
        del number, frame
        stop.ask(FINISH_RUNS)
        _later(grace_s, lambda: stop.ask(STOP_NOW))
        _later(grace_s + _LAST_MOMENT_S, lambda: os._exit(_INTERRUPTED_EXIT_CODE))
        announce(f"asked to terminate: runs in flight have {grace_s:g} s to finish")

    before = signal.signal(signal.SIGINT, on_interrupt), signal.signal(signal.SIGTERM, on_terminate)
    try:
        yield
    finally:
        signal.signal(signal.SIGINT, before[0])
        signal.signal(signal.SIGTERM, before[1])


@contextlib.contextmanager
def stopped_in_time(stop: StopRequest, left_s: Callable[[], float]) -> Iterator[None]:
    """Ask to stop at once when no seconds are left and the context has not ended; ``left_s`` may change meanwhile."""
    ended = threading.Event()

    def watch() -> None:
        while not ended.wait(min(max(left_s(), 0.0), _LONGEST_WAIT_S)):
            if left_s() <= 0:
                stop.ask(STOP_NOW)
                return

    thread = threading.Thread(target=watch, name="watch-time", daemon=True)
    thread.start()
    try:
        yield
    finally:
        ended.set()
        thread.join()


def _later(delay_s: float, action: Callable[[], None]) -> None:
    timer = threading.Timer(delay_s, action)
    timer.daemon = True
    timer.start()
