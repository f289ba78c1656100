"""Run requests in child processes of this machine."""

import tempfile
import threading
import time
from collections import deque
from concurrent.futures import CancelledError, Future
from concurrent.futures.process import BrokenProcessPool
from dataclasses import dataclass, field, replace
from functools import partial
from pathlib import Path
from typing import Self

from pebble import ProcessExpired

from gtf_tune.errors import DefinitionError, MachineError
from gtf_tune.execution.attempt import Attempt, DiskWatch, OverdueError, Retries, failure
from gtf_tune.execution.base import RunLimits
from gtf_tune.execution.paths import Scratch, default_cache_folder
from gtf_tune.execution.process import TICK_S, RunTimer, counted
from gtf_tune.execution.run_in_child import execute_in_worker
from gtf_tune.execution.stages import FreshStages, StageStore
from gtf_tune.execution.workers import Workers
from gtf_tune.operating_system import available_memory_bytes
from gtf_tune.pipelines.run import RunOutcome, RunRequest

_MEMORY_MARGIN = 1.1


@dataclass(eq=False)
class _Item:
    """A run that was submitted, from its place in the queue to its outcome."""

    request: RunRequest
    limits: RunLimits
    known_good: RunRequest | None = None
    future: "Future[RunOutcome]" = field(default_factory=Future)
    retries: Retries = field(default_factory=Retries)
    attempt: Attempt | None = None
    expected_bytes: int = 0

    @property
    def kind(self) -> tuple[str, str]:
        return self.request.pipeline.name, self.request.sequence.name


class LocalExecutor:
    """Run up to ``jobs`` requests at a time, each in a process of its own.

    Worker processes are reused between runs, so that importing a pipeline is paid once; a run that aborts, hangs or is
    killed takes its worker with it and the pool starts another. A run starts only if the peak memory measured on runs
    of the same pipeline and sequence fits beside the runs in flight.

    Parameters
    ----------
    jobs
        How many runs go side by side.
    stages
        Where runs find their stages; without one every run starts from the images.
    scratch
        Folder for the files of running runs.
    memory_bytes
        What all runs together may take; by default what the machine has available now.
    retry_elsewhere
        Whether runs that failed for no known reason are tried again by the caller, on another host.
    keep
        Folder in which the files of ended runs stay: logs, workspaces, what programs were given and wrote.
    """

    def __init__(
        self,
        jobs: int = 1,
        stages: StageStore | None = None,
        scratch: Path | None = None,
        memory_bytes: int | None = None,
        *,
        retry_elsewhere: bool = False,
        keep: Path | None = None,
    ) -> None:
        self._keep = keep
        self._jobs = jobs
        self._stages = stages or FreshStages()
        self._scratch = Scratch(scratch or default_cache_folder() / "scratch")
        self._memory_bytes = memory_bytes or available_memory_bytes()
        self._retry_elsewhere = retry_elsewhere
        self._waiting: deque[_Item] = deque()
        self._running: list[_Item] = []
        self._doubted: list[tuple[_Item, RunOutcome]] = []
        self._peaks: dict[tuple[str, str], int] = {}
        self._lock = threading.RLock()
        self._closed = threading.Event()
        self._workers = Workers()
        self._supervisor = threading.Thread(target=self._supervise, name="supervise-runs", daemon=True)

    def submit(
        self, request: RunRequest, limits: RunLimits, known_good: RunRequest | None = None
    ) -> "Future[RunOutcome]":
        """Queue a run; the future ends when the run does.

        Raises
        ------
        DefinitionError
            The class of the pipeline is defined in the main script, which the processes of runs do not import.
        """
        if type(request.pipeline).__module__ == "__main__":
            raise DefinitionError(
                f"the class of pipeline '{request.pipeline.name}' is defined in the main script, which the processes "
                "of runs do not import; move it to a module"
            )
        item = _Item(request, limits, known_good)
        with self._lock:
            self._waiting.append(item)
            if not self._supervisor.ident:
                self._supervisor.start()
        self._start_what_fits()
        return item.future

    def cancel_waiting(self) -> None:
        """Cancel every run that has not started."""
        with self._lock:
            items, self._waiting = list(self._waiting), deque()
        for item in items:
            item.future.cancel()
        self._resolve_doubts()

    def __enter__(self) -> Self:
        """Return the executor itself."""
        return self

    def __exit__(self, *_: object) -> None:
        """Stop all runs and leave no process and no file behind."""
        self._closed.set()
        self.cancel_waiting()
        self._workers.close()
        with self._lock:
            left = [(item, item.attempt) for item in self._running if item.attempt is not None]
        for item, attempt in left:  # stopped workers never report them
            self._end(item, attempt, None)
        self._scratch.close()

    def _start_what_fits(self) -> None:
        with self._lock:
            while not self._closed.is_set() and self._waiting and self._fits(self._waiting[0]):
                self._start(self._waiting.popleft())

    def _fits(self, item: _Item) -> bool:
        item.expected_bytes = int(self._peaks.get(item.kind, 0) * _MEMORY_MARGIN)
        if "killed" in item.retries.causes:  # perhaps for want of memory: it gets all of it
            item.expected_bytes = self._memory_bytes
        if not self._running:
            return True
        reserved = sum(other.expected_bytes for other in self._running)
        return len(self._running) < self._jobs and reserved + item.expected_bytes <= self._memory_bytes

    def _start(self, item: _Item) -> None:
        if not item.retries.causes and not item.future.set_running_or_notify_cancel():
            return
        self._running.append(item)
        try:
            attempt = self._begin(item)
        except MachineError as error:
            self._close_attempt(item, failure(item.request, str(error), "machine"))
            return
        item.attempt = attempt
        attempt.future.add_done_callback(lambda done: self._end(item, attempt, None if done.cancelled() else done))

    def _begin(self, item: _Item) -> Attempt:
        paths = self._scratch.paths(item.request.key[:12])
        pool = self._workers.take()
        disks = DiskWatch((self._scratch.folder, Path(tempfile.gettempdir())))
        attempt = Attempt(
            item.request, item.limits, len(item.retries.causes) + 1, paths, pool, disks, RunTimer(paths.phase)
        )
        try:
            attempt.future = pool.schedule(execute_in_worker, args=(item.request, item.limits, paths, self._stages))
        except RuntimeError as error:  # the idle process was killed this very moment
            attempt.future.set_exception(BrokenProcessPool(str(error)))
        return attempt

    def _supervise(self) -> None:
        """Count the time of running runs, and end those that take too long or that their pool has forgotten."""
        last = time.monotonic()
        while not self._closed.wait(TICK_S):
            elapsed_s, last = counted(time.monotonic() - last), time.monotonic()
            with self._lock:
                items = [(item, item.attempt) for item in self._running if item.attempt is not None]
            for item, attempt in items:
                error = attempt.look(elapsed_s)
                if error is not None:
                    self._end(item, attempt, error)

    def _end(self, item: _Item, attempt: Attempt, ended: "Future[RunOutcome] | Exception | None") -> None:
        """Take note of the end of an attempt, once: its process and the supervisor may both report it."""
        with self._lock:
            if item.attempt is not attempt:
                return
            item.attempt = None
        error = ended.exception() if isinstance(ended, Future) else ended
        if ended is None or self._closed.is_set():
            self._workers.end(attempt.pool)
            self._drop(item, CancelledError())
            return
        try:
            outcome = attempt.outcome(error)
        except Exception as fault:  # handed on to whoever asks the future
            self._workers.give_back(attempt.pool)
            self._drop(item, fault)
        else:
            died = isinstance(error, OverdueError | ProcessExpired | BrokenProcessPool)
            (self._workers.end if died else self._workers.give_back)(attempt.pool)
            self._close_attempt(item, outcome)
        finally:
            self._clear(attempt)
            self._start_what_fits()

    def _clear(self, attempt: Attempt) -> None:
        """Remove the files of an attempt, or put them where they are kept."""
        request = attempt.request
        if self._keep is not None:
            attempt.paths.keep(self._keep, f"{request.kind}-{request.index}-{request.key[:8]}")
        attempt.paths.remove()

    def _drop(self, item: _Item, error: BaseException) -> None:
        with self._lock:
            self._running.remove(item)
        item.future.set_exception(error)

    def _close_attempt(self, item: _Item, outcome: RunOutcome) -> None:
        open_elsewhere = self._retry_elsewhere and outcome.cause in ("unknown", "machine")
        again = item.retries.wanted(outcome) and not open_elsewhere
        if again and outcome.cause == "machine":
            self._stages.make_room()
        with self._lock:
            self._running.remove(item)
            self._peaks[item.kind] = max(self._peaks.get(item.kind, 0), outcome.peak_memory_bytes)
            if again and not self._closed.is_set():
                self._waiting.appendleft(item)
                return
        self._settle(item, outcome if open_elsewhere else item.retries.settled(outcome))

    def _settle(self, item: _Item, outcome: RunOutcome) -> None:
        """Hand an outcome over, unless it is a failure that this machine may have caused."""
        if outcome.status == "failed" and outcome.cause != "machine" and item.known_good is not None:
            with self._lock:
                self._doubted.append((item, outcome))
        else:
            if outcome.status == "ok":
                self._hand_over_doubted(item.kind)
            item.future.set_result(outcome)
        self._resolve_doubts()

    def _resolve_doubts(self) -> None:
        """Run what is known to work, for each kind of run of which only failures are left here."""
        with self._lock:
            busy = {item.kind for item in (*self._running, *self._waiting)}
            idle = {item.kind: item for item, _ in self._doubted if item.kind not in busy}
            checks = {
                kind: self.submit(item.known_good, item.limits)
                for kind, item in idle.items()
                if item.known_good is not None and not self._closed.is_set()
            }
        for kind, check in checks.items():
            check.add_done_callback(partial(self._checked, kind))
        for kind in idle.keys() - checks:
            self._cancel_doubted(kind)

    def _checked(self, kind: tuple[str, str], check: "Future[RunOutcome]") -> None:
        """Blame the machine for the failures of a kind where even what is known to work fails here."""
        if check.cancelled() or check.exception() is not None:
            self._cancel_doubted(kind)
        elif check.result().status == "failed":
            self._hand_over_doubted(kind, blamed_for=check.result().error)

    def _hand_over_doubted(self, kind: tuple[str, str], blamed_for: str = "") -> None:
        for item, outcome in self._take_doubted(kind):
            reason = (
                f"this machine cannot run what works elsewhere: {outcome.error}; a run that had succeeded before "
                f"failed here too: {blamed_for}"
            )
            item.future.set_result(replace(outcome, error=reason, cause="machine") if blamed_for else outcome)

    def _cancel_doubted(self, kind: tuple[str, str]) -> None:
        for item, _ in self._take_doubted(kind):
            item.future.set_exception(CancelledError())

    def _take_doubted(self, kind: tuple[str, str]) -> list[tuple[_Item, RunOutcome]]:
        with self._lock:
            taken = [pair for pair in self._doubted if pair[0].kind == kind]
            self._doubted = [pair for pair in self._doubted if pair[0].kind != kind]
        return taken
