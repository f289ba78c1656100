"""Run requests in child processes of this machine."""

import contextlib
import platform
import signal
import threading
import time
from collections import deque
from concurrent.futures import CancelledError, Future, InvalidStateError
from concurrent.futures.process import BrokenProcessPool
from dataclasses import dataclass, field
from pathlib import Path
from typing import Self

import psutil
from pebble import ProcessExpired, ProcessPool

from gtf_tune.errors import DefinitionError, StorageError
from gtf_tune.execution.base import RunLimits
from gtf_tune.execution.paths import RunPaths, Scratch, default_cache_folder
from gtf_tune.execution.run_in_child import execute_in_worker, versions_of
from gtf_tune.execution.stages import FreshStages, StageStore
from gtf_tune.execution.workers import Workers
from gtf_tune.pipelines.run import RunOutcome, RunRequest
from gtf_tune.trajectory import Trajectory

_KILLED_TRIES = 3
_KILLED_FROM_OUTSIDE = (signal.SIGKILL, signal.SIGTERM, signal.SIGHUP, signal.SIGINT)
_MEMORY_MARGIN = 1.1
_WATCH_S = 1.0


@dataclass(eq=False)
class _Item:
    request: RunRequest
    limits: RunLimits
    future: "Future[RunOutcome]" = field(default_factory=Future)
    paths: RunPaths | None = None
    pool: ProcessPool | None = None
    started: "Future[RunOutcome] | None" = None
    pool_lost: bool = False
    expected_bytes: int = 0
    tries: int = 0
    began: float = 0.0
    started_at: float = 0.0


class LocalExecutor:
    """Run up to ``jobs`` requests at a time, each in a process that survives nothing and endangers nobody.

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
    """

    def __init__(
        self,
        jobs: int = 1,
        stages: StageStore | None = None,
        scratch: Path | None = None,
        memory_bytes: int | None = None,
    ) -> None:
        self._jobs = jobs
        self._stages = stages or FreshStages()
        self._scratch = Scratch(scratch or default_cache_folder() / "scratch")
        self._memory_bytes = memory_bytes or psutil.virtual_memory().available
        self._waiting: deque[_Item] = deque()
        self._running: list[_Item] = []
        self._peaks: dict[tuple[str, str], int] = {}
        self._lock = threading.RLock()
        self._closed = False
        self._workers = Workers()
        self._ended = threading.Event()
        self._watcher = threading.Thread(target=self._watch_pools, name="watch-pools", daemon=True)

    def submit(self, request: RunRequest, limits: RunLimits) -> "Future[RunOutcome]":
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
        item = _Item(request, limits)
        with self._lock:
            self._waiting.append(item)
        self._start_what_fits()
        return item.future

    def cancel_waiting(self) -> None:
        """Cancel every run that has not started."""
        with self._lock:
            items, self._waiting = list(self._waiting), deque()
        for item in items:
            item.future.cancel()

    def __enter__(self) -> Self:
        """Return the executor itself."""
        return self

    def __exit__(self, *_: object) -> None:
        """Stop all runs and leave no process and no file behind."""
        with self._lock:
            self._closed = True
        self._ended.set()
        self.cancel_waiting()
        self._workers.close()
        self._abandon_running()
        self._scratch.close()

    def _abandon_running(self) -> None:
        """End the futures of runs that stopped workers will never speak of again."""
        with self._lock:
            left = [item for item in self._running if not item.future.done()]
        for item in left:
            item.future.set_exception(CancelledError())

    def _start_what_fits(self) -> None:
        with self._lock:
            while not self._closed and self._waiting and self._fits(self._waiting[0]):
                self._start(self._waiting.popleft())

    def _fits(self, item: _Item) -> bool:
        item.expected_bytes = int(self._peaks.get(_kind_of(item.request), 0) * _MEMORY_MARGIN)
        if item.tries:  # it was killed, perhaps for want of memory: it gets all of it
            item.expected_bytes = self._memory_bytes
        if not self._running:
            return True
        reserved = sum(other.expected_bytes for other in self._running)
        return len(self._running) < self._jobs and reserved + item.expected_bytes <= self._memory_bytes

    def _start(self, item: _Item) -> None:
        if item.paths is None and not item.future.set_running_or_notify_cancel():
            return
        item.tries += 1
        item.began, item.started_at = time.perf_counter(), time.time()
        self._running.append(item)
        try:
            item.paths = self._scratch.paths(item.request.key[:12])
            started = self._schedule(item)
        except StorageError as error:
            started = Future()
            started.set_exception(error)
        item.started = started
        started.add_done_callback(lambda done: self._finish(item, done))

    def _schedule(self, item: _Item) -> "Future[RunOutcome]":
        arguments = (item.request, item.limits, item.paths, self._stages)
        item.pool, item.pool_lost = self._workers.take(), False
        if not self._watcher.ident:
            self._watcher.start()
        try:
            started: Future[RunOutcome] = item.pool.schedule(
                execute_in_worker, args=arguments, timeout=item.limits.timeout_s
            )
        except RuntimeError as error:  # the idle process was killed this very moment
            started = Future()
            started.set_exception(BrokenProcessPool(str(error)))
        return started

    def _watch_pools(self) -> None:
        """Fail runs that their pool has forgotten, so that they are tried again.

        A pool whose process is killed before it has taken its run up stops, and sometimes never speaks of that run.
        """
        while not self._ended.wait(_WATCH_S):
            with self._lock:
                items = [item for item in self._running if item.pool is not None and not item.pool.active]
            for item in items:
                if item.pool_lost and item.started is not None:  # for the second time: the pool had its chance
                    with contextlib.suppress(InvalidStateError):
                        item.started.set_exception(BrokenProcessPool("the process was killed before it began"))
                item.pool_lost = True

    def _finish(self, item: _Item, done: "Future[RunOutcome]") -> None:
        outcome, error = self._outcome(item, done)
        self._part_with(item, done)
        with self._lock:
            self._running.remove(item)
            if outcome is not None and outcome.peak_memory_bytes:
                kind = _kind_of(item.request)
                self._peaks[kind] = max(self._peaks.get(kind, 0), outcome.peak_memory_bytes)
        if item.paths is not None:
            item.paths.remove()
        if outcome is not None:
            item.future.set_result(outcome)
        elif error is not None:
            item.future.set_exception(error)
        else:
            with self._lock:
                self._waiting.appendleft(item)
        self._start_what_fits()

    def _outcome(self, item: _Item, done: "Future[RunOutcome]") -> tuple[RunOutcome | None, BaseException | None]:
        """Return the outcome, or the error to pass on, or neither where the run deserves another try."""
        if done.cancelled():
            return None, CancelledError()
        error = done.exception()
        if error is None:
            return done.result(), None
        if self._closed:
            return None, CancelledError()
        if isinstance(error, TimeoutError):
            return _failure(item, f"no result within {item.limits.timeout_s:g} s (limits.run_timeout_s)"), None
        if isinstance(error, ProcessExpired | BrokenProcessPool):
            exitcode = error.exitcode or 0 if isinstance(error, ProcessExpired) else -signal.SIGKILL
            if -exitcode in _KILLED_FROM_OUTSIDE and item.tries < _KILLED_TRIES:
                return None, None
            return _failure(item, _death(exitcode, item.tries)), None
        return None, error

    def _part_with(self, item: _Item, done: "Future[RunOutcome]") -> None:
        """Keep the run's process for the next run if it is still there and sound."""
        if item.pool is None:
            return
        error = None if done.cancelled() else done.exception()
        died = isinstance(error, TimeoutError | ProcessExpired | BrokenProcessPool)
        if done.cancelled() or died or self._closed:
            self._workers.end(item.pool)
        else:
            self._workers.give_back(item.pool)
        item.pool = None


def _kind_of(request: RunRequest) -> tuple[str, str]:
    return request.pipeline.name, request.sequence.name


def _failure(item: _Item, reason: str) -> RunOutcome:
    return RunOutcome(
        status="failed",
        trajectory=Trajectory.empty(),
        error=reason,
        wall_s=time.perf_counter() - item.began,
        host=platform.node(),
        started_at=item.started_at,
        versions=versions_of(item.request),
        log=item.paths.read_log_tail() if item.paths else "",
    )


def _death(exitcode: int, tries: int) -> str:
    if exitcode >= 0:
        return f"the pipeline ended its process with exit code {exitcode}"
    name = signal.Signals(-exitcode).name
    if name == "SIGKILL":
        return f"the run was killed {tries} times (SIGKILL), most likely for want of memory"
    if -exitcode in _KILLED_FROM_OUTSIDE:
        return f"the run was ended from outside {tries} times ({name})"
    return f"the pipeline crashed its process ({name})"
