"""Obtain the runs of a trial: from the database where they exist, from the executor otherwise."""

import contextlib
from collections.abc import Callable, Iterable, Mapping, Sequence
from concurrent.futures import FIRST_COMPLETED, CancelledError, Future, wait
from dataclasses import dataclass, field, replace

import numpy as np

from gtf_tune.definition import LimitsDefinition
from gtf_tune.errors import StorageError
from gtf_tune.execution import Executor, RunLimits
from gtf_tune.pipelines.run import RunKind, RunOutcome, RunRequest, digest
from gtf_tune.sequence import Sequence as ImageSequence
from gtf_tune.store import runs
from gtf_tune.store.database import Database
from gtf_tune.store.runs import StoredRun, TrialRun, digest_of, trajectories
from gtf_tune.study.events import Callback, RunFinished, ignore
from gtf_tune.study.runs.plan import FinishedRun
from gtf_tune.study.runs.stop import STOP_NOW, StopRequest
from gtf_tune.trajectory import Trajectory


@dataclass(frozen=True, eq=False)
class SequenceRuns:
    """Trajectories of the clean and of the noisy runs of one configuration, in the order in which they count.

    Those of failed runs are empty, and ``errors`` says why runs failed, those of clean runs first. ``num_frames`` is
    the length of the sequence.
    """

    clean: tuple[Trajectory, ...]
    noisy: tuple[Trajectory, ...]
    num_frames: int
    errors: tuple[str, ...] = ()

    def at(self, frames: frozenset[int]) -> "SequenceRuns":
        """Return the runs with their poses at these frames only."""
        ids = np.array(sorted(frames), dtype=np.int64)
        clean, noisy = (
            tuple(run.select(np.isin(run.frame_ids, ids)) for run in runs) for runs in (self.clean, self.noisy)
        )
        return replace(self, clean=clean, noisy=noisy)

    @property
    def clean_coverage(self) -> tuple[float, ...]:
        """Registered frames of each clean run over the frames of the sequence."""
        return tuple(len(run) / self.num_frames for run in self.clean)

    @property
    def noisy_coverage(self) -> tuple[float, ...]:
        """Registered frames of each noisy run over the frames of the sequence."""
        return tuple(len(run) / self.num_frames for run in self.noisy)


def sequence_runs(runs: Iterable[tuple[RunKind, Trajectory, str]], num_frames: int) -> SequenceRuns:
    """Return the runs of one sequence, given as kind, trajectory and error in the order in which they count."""
    listed = list(runs)
    clean, noisy = ([run for run in listed if run[0] == kind] for kind in ("clean", "noisy"))
    return SequenceRuns(
        clean=tuple(trajectory for _, trajectory, _ in clean),
        noisy=tuple(trajectory for _, trajectory, _ in noisy),
        num_frames=num_frames,
        errors=tuple(error for _, _, error in [*clean, *noisy] if error),
    )


def finished_by_sequence(runs: Sequence[FinishedRun]) -> dict[str, SequenceRuns]:
    """Return finished runs by the name of their sequence, in the order in which they are given."""
    frames = {run.request.sequence.name: len(run.request.sequence) for run in runs}
    return {
        name: sequence_runs(
            ((run.request.kind, run.trajectory, run.stored.error) for run in runs if run.request.sequence.name == name),
            num_frames,
        )
        for name, num_frames in frames.items()
    }


def stored_by_sequence(database: Database, runs: Sequence[TrialRun]) -> dict[str, SequenceRuns]:
    """Return the stored runs of one trial by the name of their sequence, ordered by their index.

    Raises
    ------
    StorageError
        A trajectory is not the one that was stored.
    """
    found = trajectories(database, list(dict.fromkeys(use.run.key for use in runs)))
    frames = {use.sequence_name: use.run.num_frames for use in runs}
    return {name: _of_stored(found, runs, name, num_frames) for name, num_frames in frames.items()}


def _of_stored(found: Mapping[str, Trajectory], runs: Sequence[TrialRun], name: str, num_frames: int) -> SequenceRuns:
    mine = sorted((use.run for use in runs if use.sequence_name == name), key=lambda run: run.index)
    return sequence_runs(((run.kind, found[run.key], run.error) for run in mine), num_frames)


_POLL_S = 0.2
_GIB = 2**30


class Interrupted(Exception):
    """Signal that someone asked to stop before the trial was complete; what has finished is stored."""


class NothingWorksError(Exception):
    """Signal that runs failed where none on their images has ever worked: this machine may be at fault."""


@dataclass(frozen=True)
class RunSource:
    """Provide finished runs: reuse what is stored, execute and store the rest.

    ``on_event`` gets a `RunFinished` for each run. ``nominal_run`` returns the nominal run on a sequence: where that
    one has succeeded, executors check by it whether a failure is the configuration's or the machine's. Where it has
    not, and ``doubts_failures``, a failure beside which no run succeeds is not stored but raised.
    """

    database: Database
    executor: Executor
    limits: RunLimits
    stop: StopRequest
    on_event: Callback = ignore
    nominal_run: Callable[[ImageSequence], RunRequest] | None = None
    doubts_failures: bool = False

    def obtain(self, requests: Sequence[RunRequest]) -> list[FinishedRun]:
        """Return a finished run for every request, in the same order.

        Raises
        ------
        Interrupted
            Someone asked to stop; runs that finished are stored.
        MachineError
            This machine is at fault; what failed because of it is stored under a key that is never reused.
        NothingWorksError
            Failures are doubted, and nothing shows that this machine can make runs on these images.
        """
        obtained = self._stored(requests)
        for run in obtained.values():
            self.on_event(RunFinished(run))
        missing = {place: request for place, request in enumerate(requests) if place not in obtained}
        obtained.update(self._execute(missing))
        return [obtained[place] for place in range(len(requests))]

    def _stored(self, requests: Sequence[RunRequest]) -> dict[int, FinishedRun]:
        """Return the runs that are stored already, by the place of their request."""
        keys = [(request.key, failed_key(request, self.limits)) for request in requests]
        known = runs.find(self.database, [key for both in keys for key in both])
        found: dict[int, StoredRun] = {}
        for place, both in enumerate(keys):
            stored = next((known[key] for key in both if key in known), None)  # a result counts more than a failure
            if stored is not None:
                found[place] = stored
        poses = trajectories(self.database, list(dict.fromkeys(run.key for run in found.values())))
        for run in found.values():
            if run.key not in poses:
                raise StorageError(f"run {run.key} has lost its trajectory; restore a backup")
        return {place: FinishedRun(requests[place], run, poses[run.key], reused=True) for place, run in found.items()}

    def known_good(self, requests: Iterable[RunRequest]) -> dict[str, RunRequest]:
        """Return the nominal run on each of the requests' sequences, by fingerprint, where it has succeeded."""
        if self.nominal_run is None:
            return {}
        sequences = {request.sequence.fingerprint: request.sequence for request in requests}
        nominal = {fingerprint: self.nominal_run(sequence) for fingerprint, sequence in sequences.items()}
        known = runs.find(self.database, [request.key for request in nominal.values()])
        return {fingerprint: request for fingerprint, request in nominal.items() if request.key in known}

    def _execute(self, missing: Mapping[int, RunRequest]) -> dict[int, FinishedRun]:
        if not missing:
            return {}
        if self.stop.level:
            raise Interrupted
        batch = _Batch(self, missing)
        return batch.finish()


@dataclass
class _Batch:
    """Runs that one trial waits for, by the place of their request; each is stored as soon as it ends."""

    source: RunSource
    requests: Mapping[int, RunRequest]
    finished: dict[int, FinishedRun] = field(default_factory=dict)
    doubted: dict[int, RunOutcome] = field(default_factory=dict)

    def finish(self) -> dict[int, FinishedRun]:
        """Wait for all runs and return them as stored."""
        source = self.source
        good = source.known_good(self.requests.values())
        waiting = {
            place: source.executor.submit(request, source.limits, good.get(request.sequence.fingerprint))
            for place, request in self.requests.items()
        }
        cancelled = False
        while waiting:
            if source.stop.level and not cancelled:
                cancelled = True
                source.executor.cancel_waiting()
            if source.stop.level >= STOP_NOW:
                raise Interrupted
            wait(list(waiting.values()), timeout=_POLL_S, return_when=FIRST_COMPLETED)
            for place in [place for place, future in waiting.items() if future.done()]:
                self._take(place, waiting.pop(place), doubted=source.doubts_failures and not good)
        self._judge_doubted()
        if len(self.finished) < len(self.requests):
            raise Interrupted
        return self.finished

    def _take(self, place: int, future: "Future[RunOutcome]", *, doubted: bool) -> None:
        try:
            outcome = future.result()
        except CancelledError:
            return
        if outcome.status != "ok" and self.source.stop.level:
            return  # whoever stops us, as batch systems and systemd do, may have ended the run too
        request = self.requests[place]
        if outcome.status != "ok" and outcome.cause == "machine":
            with contextlib.suppress(StorageError):  # it may be the database's disk that is full
                runs.save(self.source.database, request, outcome, _fault_key(request, outcome))
        outcome.raise_for_machine()
        if outcome.status != "ok" and doubted:
            self.doubted[place] = outcome
        else:
            self._store(place, outcome)

    def _judge_doubted(self) -> None:
        """Store the failures that were doubted where other runs have worked here, and raise where none has."""
        worked = any(run.stored.status == "ok" for run in self.finished.values())
        for place, outcome in self.doubted.items():
            if not worked:
                raise NothingWorksError(outcome.error)
            self._store(place, outcome)

    def _store(self, place: int, outcome: RunOutcome) -> None:
        request = self.requests[place]
        key = request.key if outcome.status == "ok" else failed_key(request, self.source.limits)
        stored = runs.save(self.source.database, request, outcome, key)
        run = FinishedRun(request, stored, self._trajectory(stored, outcome), reused=False)
        self.finished[place] = run
        self.source.on_event(RunFinished(run))

    def _trajectory(self, stored: StoredRun, outcome: RunOutcome) -> Trajectory:
        """Return the stored trajectory, which is another worker's where that one stored the same run first."""
        if stored.trajectory_digest == digest_of(outcome.trajectory):
            return replace(outcome.trajectory, has_timestamps=True, source="")  # which are not stored
        return trajectories(self.source.database, [stored.key])[stored.key]


def failed_key(request: RunRequest, limits: RunLimits) -> str:
    """Return the key under which a failed run is stored: a run with other limits deserves a try of its own."""
    return digest({"failed": request.key, "timeout_s": limits.timeout_s, "memory_bytes": limits.memory_bytes})


def _fault_key(request: RunRequest, outcome: RunOutcome) -> str:
    """Return the key under which a fault of a machine is stored, by which nobody looks for a run."""
    return digest({"machine": request.key, "host": outcome.host, "started_at": outcome.started_at})


def run_limits(limits: LimitsDefinition) -> RunLimits:
    """Return the limits of one run as an executor takes them."""
    return RunLimits(limits.run_timeout_s, int(limits.run_memory_gb * _GIB))
