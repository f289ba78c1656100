"""Obtain the runs of a trial: from the database where they exist, from the executor otherwise."""

from collections.abc import Mapping, Sequence
from concurrent.futures import FIRST_COMPLETED, CancelledError, Future, wait
from dataclasses import dataclass, field
from typing import Protocol

from gtf_tune.definition import LimitsDefinition
from gtf_tune.execution import Executor, RunLimits
from gtf_tune.pipelines.run import RunKind, RunOutcome, RunRequest, digest
from gtf_tune.store import runs
from gtf_tune.store.database import Database
from gtf_tune.store.runs import StoredRun
from gtf_tune.study.runs.stop import STOP_NOW, StopRequest

_POLL_S = 0.2
_GIB = 2**30


class Interrupted(Exception):
    """Signal that someone asked to stop before the trial was complete; what has finished is stored."""


@dataclass(frozen=True)
class RunSlot:
    """Name one run of a trial: sequence, kind and index."""

    sequence: str
    kind: RunKind
    index: int


class RunListener(Protocol):
    """Hear of runs as they end."""

    def run_finished(self, slot: RunSlot, run: StoredRun, *, reused: bool) -> None:
        """Take note of a run that is now stored."""
        ...

    def noise_started(self, sequence: str, sigma: float, planned_runs: int) -> None:
        """Take note that runs with this noise (grey levels) begin, by which the noise of a study is chosen."""
        ...

    def noise_chosen(self, sequence: str, sigma: float, reason: str) -> None:
        """Take note of the noise (grey levels) that a study takes for a sequence from now on."""
        ...


@dataclass(frozen=True)
class RunSource:
    """Provide finished runs: reuse what is stored, execute and store the rest."""

    database: Database
    executor: Executor
    limits: RunLimits
    stop: StopRequest
    listener: RunListener

    def obtain(self, requests: Mapping[RunSlot, RunRequest]) -> dict[RunSlot, "ObtainedRun"]:
        """Return a finished run for every request, in the same order.

        Raises
        ------
        Interrupted
            Someone asked to stop; runs that finished are stored.
        """
        keys = {slot: (request.key, failed_key(request, self.limits)) for slot, request in requests.items()}
        known = runs.find(self.database, [key for both in keys.values() for key in both])
        obtained = {
            slot: ObtainedRun(known[key], reused=True)
            for slot, both in keys.items()
            for key in reversed(both)  # a result counts more than a failure
            if key in known
        }
        for slot, run in obtained.items():
            self.listener.run_finished(slot, run.run, reused=True)
        missing = {slot: request for slot, request in requests.items() if slot not in obtained}
        obtained.update(self._execute(missing))
        return {slot: obtained[slot] for slot in requests}

    def _execute(self, missing: Mapping[RunSlot, RunRequest]) -> dict[RunSlot, "ObtainedRun"]:
        if not missing:
            return {}
        if self.stop.level:
            raise Interrupted
        batch = _Batch(self, missing)
        return batch.finish()


@dataclass(frozen=True)
class ObtainedRun:
    """Hold a stored run and whether it was there before the trial asked for it."""

    run: StoredRun
    reused: bool


@dataclass
class _Batch:
    """Follow the runs that one trial waits for, and store each as soon as it ends."""

    source: RunSource
    requests: Mapping[RunSlot, RunRequest]
    finished: dict[RunSlot, ObtainedRun] = field(default_factory=dict)

    def finish(self) -> dict[RunSlot, ObtainedRun]:
        """Wait for all runs and return them as stored."""
        futures = {
            slot: self.source.executor.submit(request, self.source.limits) for slot, request in self.requests.items()
        }
        told = False
        waiting = dict(futures)
        while waiting:
            if self.source.stop.level and not told:
                told = True
                self.source.executor.cancel_waiting()
            if self.source.stop.level >= STOP_NOW:
                raise Interrupted
            _wait_a_little(list(waiting.values()))
            for slot in [slot for slot, future in waiting.items() if future.done()]:
                self._store(slot, waiting.pop(slot))
        if len(self.finished) < len(self.requests):
            raise Interrupted
        return self.finished

    def _store(self, slot: RunSlot, future: "Future[RunOutcome]") -> None:
        try:
            outcome = future.result()
        except CancelledError:
            return
        if outcome.status != "ok" and self.source.stop.level:
            return  # who stops us, as batch systems and systemd do, may have ended the run too
        request = self.requests[slot]
        key = request.key if outcome.status == "ok" else failed_key(request, self.source.limits)
        run = runs.save(self.source.database, request, outcome, key)
        self.finished[slot] = ObtainedRun(run, reused=False)
        self.source.listener.run_finished(slot, run, reused=False)


def failed_key(request: RunRequest, limits: RunLimits) -> str:
    """Return the key under which a failed run is stored: a run with other limits deserves a try of its own."""
    return digest({"failed": request.key, "timeout_s": limits.timeout_s, "memory_bytes": limits.memory_bytes})


def run_limits(limits: LimitsDefinition) -> RunLimits:
    """Return the limits of one run as an executor takes them."""
    return RunLimits(limits.run_timeout_s, int(limits.run_memory_gb * _GIB))


def _wait_a_little(futures: Sequence["Future[RunOutcome]"]) -> None:
    wait(futures, timeout=_POLL_S, return_when=FIRST_COMPLETED)
