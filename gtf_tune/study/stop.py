"""Stop a study on request: once to finish the runs in flight, twice to stop at once."""

import contextlib
import signal
import threading
from collections.abc import Callable, Iterator
from types import FrameType

FINISH_RUNS = 1
STOP_NOW = 2


class StopRequest:
    """Remember how urgently someone asked to stop; safe to raise from signal handlers and other threads."""

    def __init__(self) -> None:
        self._level = 0
        self._event = threading.Event()

    @property
    def level(self) -> int:
        """Return 0 (go on), `FINISH_RUNS` or `STOP_NOW`."""
        return self._level

    def ask(self, level: int) -> None:
        """Ask to stop, at least as urgently as ``level``."""
        self._level = max(self._level, level)
        self._event.set()

    def wait(self, timeout_s: float) -> bool:
        """Wait until someone asks to stop, and return whether someone has."""
        return self._event.wait(timeout_s)


@contextlib.contextmanager
def signals_to(stop: StopRequest, announce: Callable[[str], None], grace_s: float = 8.0) -> Iterator[None]:
    """Turn Ctrl-C and SIGTERM into stop requests for the length of a context.

    The first Ctrl-C asks to finish the runs in flight, the second to stop at once. SIGTERM asks to finish them and
    gives them ``grace_s`` seconds, because a pre-empted machine disappears soon after.
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
        announce(f"asked to terminate: runs in flight have {grace_s:g} s to finish")
        timer = threading.Timer(grace_s, stop.ask, [STOP_NOW])
        timer.daemon = True
        timer.start()

    before = signal.signal(signal.SIGINT, on_interrupt), signal.signal(signal.SIGTERM, on_terminate)
    try:
        yield
    finally:
        signal.signal(signal.SIGINT, before[0])
        signal.signal(signal.SIGTERM, before[1])
