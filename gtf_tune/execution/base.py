"""State what an executor is: something that turns run requests into outcomes."""

from concurrent.futures import Future
from dataclasses import dataclass
from types import TracebackType
from typing import Protocol, Self

from gtf_tune.pipelines.run import RunOutcome, RunRequest


@dataclass(frozen=True)
class RunLimits:
    """Limit one run: wall time in seconds and memory in bytes."""

    timeout_s: float
    memory_bytes: int


class Executor(Protocol):
    """Run requests in child processes, several at a time.

    Safe to call from several threads. A run that fails in any way (error, abort, hang, out of memory) is an outcome
    with ``status="failed"``, not an exception. A future raises `StorageError` where this machine is at fault (disk
    full, read-only folder) and `CancelledError` where the executor was told to stop; neither is a result.
    """

    def submit(self, request: RunRequest, limits: RunLimits) -> Future[RunOutcome]:
        """Queue a run; the future ends when the run does."""
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
