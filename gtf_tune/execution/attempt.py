"""One attempt at a run: its process, its files, what it has used, and how it ended."""

import os
import platform
import shutil
import signal
import time
from collections.abc import Iterable
from concurrent.futures import Future
from concurrent.futures.process import BrokenProcessPool
from dataclasses import dataclass, field, replace
from pathlib import Path
from types import MappingProxyType

from pebble import ProcessExpired, ProcessPool

from gtf_tune.execution.base import RunLimits
from gtf_tune.execution.paths import RunPaths
from gtf_tune.execution.process import STARTING, RunTimer, cause_of_death
from gtf_tune.execution.run_in_child import versions_of
from gtf_tune.operating_system import SIGKILL
from gtf_tune.pipelines.run import FailureCause, RunOutcome, RunRequest
from gtf_tune.trajectory import Trajectory

_LEAST_BYTES = 64 * 2**20
_LEAST_SHARE = 0.25
_MB = 10**6


class DiskWatch:
    """The least room on some disks since the watch began.

    A run that fails because a disk is full cleans up after itself, and programs report it in a hundred ways (SQLite
    errors, SIGABRT, a message of their own), so only what was seen while it ran can show it.
    """

    def __init__(self, folders: Iterable[Path]) -> None:
        self._first = {folder: _free_bytes(folder) for folder in folders}
        self._least = dict(self._first)

    def look(self) -> None:
        """Note how much room there is now."""
        for folder, least in self._least.items():
            self._least[folder] = min(least, _free_bytes(folder))

    def shortage(self) -> str:
        """Return which disk was nearly full, as the beginning of a sentence; an empty text where none was.

        A disk was nearly full where little was left, or little beside what was taken since the watch began: what is
        written between two looks is not seen.
        """
        self.look()
        for folder, least in self._least.items():
            if least < max(_LEAST_BYTES, _LEAST_SHARE * (self._first[folder] - least)):
                return f"the disk of {folder} was nearly full, with {least / _MB:.0f} MB left"
        return ""


def _free_bytes(folder: Path) -> int:
    """Return the bytes that may still be written; 0 where no file can be made, and where the folder is gone."""
    try:
        no_file_left = hasattr(os, "statvfs") and 0 == os.statvfs(folder).f_favail < os.statvfs(folder).f_files
        return 0 if no_file_left else shutil.disk_usage(folder).free
    except OSError:
        return 0


class OverdueError(Exception):
    """Signal a run that takes longer than its limit; the message is the phase, empty for the run itself."""


@dataclass(eq=False)
class Attempt:
    """A process that works on a run; ``number`` counts the attempts at it from 1."""

    request: RunRequest
    limits: RunLimits
    number: int
    paths: RunPaths
    pool: ProcessPool
    disks: DiskWatch
    timer: RunTimer
    future: "Future[RunOutcome]" = field(default_factory=Future)
    pool_lost: bool = False
    began: float = field(default_factory=time.perf_counter)
    started_at: float = field(default_factory=time.time)

    def look(self, elapsed_s: float) -> Exception | None:
        """Count a tick, and return why the attempt is over where it is.

        A pool whose process is killed before it has taken its run up stops, and sometimes never reports that run.
        """
        self.disks.look()
        self.timer.count(elapsed_s)
        stage = self.timer.overdue(self.limits.timeout_s)
        if stage is not None:
            return OverdueError(stage)
        if self.pool.active:
            return None
        if self.pool_lost:  # for the second time: the pool had its chance
            return BrokenProcessPool("the process was killed before it began")
        self.pool_lost = True
        return None

    def outcome(self, error: BaseException | None) -> RunOutcome:
        """Return how the attempt ended: as its process says, or with the ``error`` that ended it.

        Raises
        ------
        Exception
            The ``error``, where it is none of a run.
        """
        outcome = self.future.result() if error is None else self._ended_by(error)
        shortage = self.disks.shortage() if outcome.status != "ok" else ""
        if not shortage:
            return outcome
        full = f"{shortage}; make room or choose another folder for the cache (a run failed: {outcome.error})"
        return replace(outcome, error=full, cause="machine")

    def _ended_by(self, error: BaseException) -> RunOutcome:
        if isinstance(error, OverdueError):
            if str(error) == STARTING:
                return self._failed("its process could not be started in time; end other programs", "machine")
            stage = f", in stage '{error}'" if str(error) else ""
            reason = f"no result within {self.limits.timeout_s:g} s (limits.run_timeout_s){stage}"
            # A program that hangs, or that other programs kept from computing, may do better the next time.
            return self._failed(reason, "configuration" if self.timer.was_busy() else "unknown")
        if isinstance(error, ProcessExpired):
            return self._failed(*_death(error.exitcode or 0, self.number))
        if isinstance(error, BrokenProcessPool):
            return self._failed(*_death(-SIGKILL, self.number))
        raise error

    def _failed(self, reason: str, cause: FailureCause) -> RunOutcome:
        elapsed_s = time.perf_counter() - self.began
        return failure(self.request, reason, cause, wall_s=elapsed_s, started_at=self.started_at, log=self.paths)


def failure(
    request: RunRequest,
    reason: str,
    cause: FailureCause,
    *,
    wall_s: float = 0.0,
    started_at: float = 0.0,
    log: RunPaths | None = None,
) -> RunOutcome:
    """Return the outcome of a run that failed without saying so itself."""
    return RunOutcome(
        status="failed",
        trajectory=Trajectory.empty(),
        error=reason,
        wall_s=wall_s,
        host=platform.node(),
        started_at=started_at or time.time(),
        versions=versions_of(request),
        log=log.read_log_tail() if log else "",
        cause=cause,
    )


def _death(exitcode: int, tries: int) -> tuple[str, FailureCause]:
    if exitcode >= 0:
        return f"the pipeline ended its process with exit code {exitcode}", "unknown"
    name, cause = signal.Signals(-exitcode).name, cause_of_death(-exitcode)
    reasons = {
        "killed": f"the run was killed {tries} times ({name}), most likely for want of memory",
        "terminated": f"the run was ended from outside {tries} times ({name}); find out by whom",
    }
    return reasons.get(cause, f"the pipeline crashed its process ({name})"), cause


_TRIES = MappingProxyType({"configuration": 1, "unknown": 2, "machine": 2, "killed": 3, "terminated": 3})


@dataclass
class Retries:
    """The attempts that one run has had."""

    causes: list[FailureCause] = field(default_factory=list)

    def wanted(self, outcome: RunOutcome) -> bool:
        """Note how an attempt ended, and return whether another one is due."""
        if outcome.status == "ok":
            return False
        self.causes.append(outcome.cause)
        return self.causes.count(outcome.cause) < _TRIES[outcome.cause]

    def settled(self, outcome: RunOutcome) -> RunOutcome:
        """Return the last outcome with the number of attempts and what its failure means.

        What happened again without a sign that the machine was at fault is due to the configuration. SIGKILL is how
        systems take memory back, and the last attempt had all of it; other signals come from people and schedulers.
        """
        earlier = len(self.causes) - (outcome.status != "ok")
        of_machine = outcome.cause in ("machine", "terminated")
        return replace(outcome, attempts=earlier + outcome.attempts, cause="machine" if of_machine else "configuration")
