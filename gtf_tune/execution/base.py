"""What an executor is: something that turns run requests into outcomes."""

from concurrent.futures import Future
from dataclasses import dataclass
from types import TracebackType
from typing import Protocol, Self

from gtf_tune.pipelines.run import RunOutcome, RunRequest


@dataclass(frozen=True)
class RunLimits:
    """What one run may take: seconds for itself, as many for each stage that it builds, and bytes of memory.

    Waits for other runs and the time in which the machine sleeps do not count (see `run_timer`).
    """

    timeout_s: float
    memory_bytes: int


class Executor(Protocol):
    """Run requests in child processes, several at a time.

    Safe to call from several threads. A run that fails in any way (error, abort, hang, out of memory, full disk) is an
    outcome with ``status="failed"``, not an exception. What the program reports itself is the configuration's failure.
    All else is tried once more, on another host where there is one; it is the machine's failure where the disk was
    nearly full, permissions or programs are missing or someone ended the run, and the configuration's otherwise. A
    future raises `SequenceError` where images cannot be read, and `CancelledError` where the executor was told to stop.
    """

    def submit(
        self, request: RunRequest, limits: RunLimits, known_good: RunRequest | None = None
    ) -> Future[RunOutcome]:
        """Queue a run; the future ends when the run does.

        ``known_good`` is a run of the same pipeline and sequence that has succeeded. Where ``request`` fails and no
        such run succeeds on its host afterwards, ``known_good`` is run there too: if it fails, the machine is at fault.
        """
        ...

    def cancel_waiting(self) -> None:
        """Cancel every run that has not started."""
        ...

    def __enter__(self) -> Self:
        """Return the executor itself."""
        ...

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        traceback: TracebackType | None,
    ) -> None:
        """Stop all runs and leave no process behind."""
        ...
