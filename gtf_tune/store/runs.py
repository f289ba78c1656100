"""Store finished runs by their keys, and find them again so that none is ever repeated."""

import hashlib
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

from sqlalchemy import ColumnElement, Text, case, func, insert, select, type_coerce
from sqlalchemy.orm import Session

from gtf_tune.errors import StorageError, TrajectoryError
from gtf_tune.pipelines.base import DiagnosticValue
from gtf_tune.pipelines.options import OptionValue
from gtf_tune.pipelines.run import RunKind, RunOutcome, RunRequest, RunStatus
from gtf_tune.store.database import Database, models
from gtf_tune.store.database.session import chunks, columns_of, read, read_rows, table_of, write

if TYPE_CHECKING:  # takes scipy, which no reader of studies needs
    from gtf_tune.trajectory import Trajectory


@dataclass(frozen=True)
class StoredRun:
    """Stored run without its trajectory (see `trajectories`) and log (see `log`)."""

    id: int
    key: str
    pipeline: str
    version: str
    settings: Mapping[str, str]
    options: Mapping[str, OptionValue]
    sequence_fingerprint: str
    kind: RunKind
    index: int
    noise_sigma: float
    noise_seed: int
    seed: int
    threads: int
    status: RunStatus
    error: str
    started_at: float
    wall_s: float
    peak_memory_bytes: int
    host: str
    versions: Mapping[str, str]
    num_frames: int
    num_poses: int
    diagnostics: Mapping[str, DiagnosticValue]
    trajectory_digest: str

    @property
    def coverage(self) -> float:
        """Return registered frames over frames of the sequence."""
        return self.num_poses / self.num_frames if self.num_frames else 0.0


@dataclass(frozen=True)
class TrialRun:
    """Run that the trial of this number uses for one sequence.

    ``reused`` is true where the run was stored before the trial asked for it.
    """

    number: int
    sequence_name: str
    run: StoredRun
    reused: bool


@dataclass(frozen=True)
class RunTotals:
    """Cost of a study: runs that were made for it, runs that were there already, seconds of those made."""

    made: int
    reused: int
    failed: int
    made_s: float
    reused_s: float


def find(database: Database, keys: Iterable[str]) -> dict[str, StoredRun]:
    """Return the stored runs among these keys."""
    found: dict[str, StoredRun] = {}
    for some in chunks(keys):
        query = select(*columns_of(models.Run, StoredRun)).where(models.Run.key.in_(some))
        found.update((run.key, run) for run in (StoredRun(*row) for row in read_rows(database, query)))
    return found


def save(database: Database, request: RunRequest, outcome: RunOutcome, key: str = "") -> StoredRun:
    """Store how a run ended and return what is stored: the first writer of a key wins.

    ``key`` is that of the request where none is given.

    Raises
    ------
    StorageError
        The database cannot be written to; a full disk says so.
    """
    from gtf_tune.trajectory import to_bytes

    row = {**_row(request, outcome), "key": key or request.key}
    trajectory = to_bytes(outcome.trajectory)

    def work(session: Session) -> StoredRun:
        if session.connection().scalar(select(models.Run.id).where(models.Run.key == row["key"])):
            return _one(session, row["key"])
        # Not as objects: bookkeeping of a row that nobody changes takes longer than writing it.
        execute = session.connection().execute
        run_id = execute(insert(table_of(models.Run)).returning(models.Run.id), row).scalar_one()
        execute(insert(table_of(models.RunOutput)), {"run_id": run_id, "trajectory": trajectory, "log": outcome.log})
        return StoredRun(id=run_id, **row)

    return write(database, work)


def _row(request: RunRequest, outcome: RunOutcome) -> dict[str, Any]:
    return {
        "pipeline": request.pipeline.name,
        "version": request.pipeline.version,
        "settings": dict(request.pipeline.settings),
        "options": dict(request.options),
        "sequence_fingerprint": request.sequence.fingerprint,
        "kind": request.kind,
        "index": request.index,
        "noise_sigma": request.noise_sigma,
        "noise_seed": request.noise_seed,
        "seed": request.seed,
        "threads": request.threads,
        "status": outcome.status,
        "error": outcome.error,
        "started_at": outcome.started_at,
        "wall_s": outcome.wall_s,
        "peak_memory_bytes": outcome.peak_memory_bytes,
        "host": outcome.host,
        "versions": dict(outcome.versions),
        "num_frames": len(request.sequence),
        "num_poses": len(outcome.trajectory),
        "diagnostics": {**outcome.diagnostics, **_failure_of(outcome)},
        "trajectory_digest": digest_of(outcome.trajectory),
    }


def _failure_of(outcome: RunOutcome) -> dict[str, DiagnosticValue]:
    """Return how often a run was tried and who is at fault, where it did not work the first time."""
    cause: dict[str, DiagnosticValue] = {"failure": outcome.cause} if outcome.status == "failed" else {}
    return {**cause, "attempts": outcome.attempts} if cause or outcome.attempts > 1 else {}


def _one(session: Session, key: str) -> StoredRun:
    return StoredRun(*session.execute(select(*columns_of(models.Run, StoredRun)).where(models.Run.key == key)).one())


def link(database: Database, trial_id: int, uses: Sequence[TrialRun]) -> None:
    """Store which runs a trial uses; doing so again does not change which of them it reused."""

    def work(session: Session) -> None:
        query = select(models.TrialRun).where(models.TrialRun.trial_id == trial_id)
        known = {(row.sequence_name, row.kind, row.index): row for row in session.scalars(query)}
        for use in uses:
            row = known.get((use.sequence_name, use.run.kind, use.run.index))
            if row is None:
                session.add(_link_row(trial_id, use))
            elif row.run_id != use.run.id:
                row.run_id, row.reused = use.run.id, use.reused

    write(database, work)


def _link_row(trial_id: int, use: TrialRun) -> models.TrialRun:
    return models.TrialRun(
        trial_id=trial_id,
        sequence_name=use.sequence_name,
        kind=use.run.kind,
        index=use.run.index,
        run_id=use.run.id,
        reused=use.reused,
    )


def of_trial(database: Database, trial_id: int) -> list[TrialRun]:
    """Return the runs of one trial, by sequence, kind and index."""
    return _linked(database, models.Trial.id == trial_id)


def of_study(database: Database, study_id: int) -> list[TrialRun]:
    """Return the runs of all trials of a study, by number, sequence, kind and index."""
    return _linked(database, models.Trial.study_id == study_id)


def totals(database: Database, study_id: int) -> RunTotals:
    """Return the cost of a study by one query; ``failed`` counts runs of both kinds, a run used twice counts twice."""
    link_, run = models.TrialRun, models.Run
    reused = link_.reused.is_(True)
    query = (
        select(
            func.count(case((~reused, 1))),
            func.count(case((reused, 1))),
            func.count(case((run.status == "failed", 1))),
            func.coalesce(func.sum(case((~reused, run.wall_s))), 0.0),
            func.coalesce(func.sum(case((reused, run.wall_s))), 0.0),
        )
        .join(run, run.id == link_.run_id)
        .join(models.Trial, models.Trial.id == link_.trial_id)
        .where(models.Trial.study_id == study_id)
    )
    return RunTotals(*read_rows(database, query)[0])


def count_unlinked(database: Database, fingerprints: Iterable[str], seeds: Iterable[int]) -> int:
    """Return how many runs on these sequences with these seeds belong to no trial."""
    run, link_ = models.Run, models.TrialRun
    query = (
        select(func.count())
        .select_from(run)
        .outerjoin(link_, link_.run_id == run.id)
        .where(run.sequence_fingerprint.in_(list(fingerprints)), run.seed.in_(list(seeds)), link_.run_id.is_(None))
    )
    return int(read_rows(database, query)[0][0])


@dataclass(frozen=True)
class MachineFault:
    """Runs that failed because of a machine, for one reason: on which host, how many, and when last."""

    host: str
    reason: str
    runs: int
    last_at: float

    @property
    def text(self) -> str:
        """The fault in words."""
        counted = "1 run" if self.runs == 1 else f"{self.runs} runs"
        return f"{counted} failed because of {self.host}, not of the configuration: {self.reason}"


def of_machine() -> ColumnElement[bool]:
    """Return the condition that a run failed because of a machine."""
    noted = type_coerce(models.Run.diagnostics, Text).contains('"failure":"machine"', autoescape=True)
    return (models.Run.status == "failed") & noted


def machine_faults(database: Database, study_id: int) -> list[MachineFault]:
    """Return what machines did to runs on the images of a study, the latest first; no trial refers to such runs."""
    run, images = models.Run, select(models.Sequence.fingerprint).where(models.Sequence.study_id == study_id)
    last = func.max(run.started_at)
    query = (
        select(run.host, run.error, func.count(run.id), last)
        .where(of_machine(), run.sequence_fingerprint.in_(images))
        .group_by(run.host, run.error)
        .order_by(last.desc())
    )
    return [MachineFault(*row) for row in read_rows(database, query)]


def _linked(database: Database, condition: Any) -> list[TrialRun]:
    link_, trial = models.TrialRun, models.Trial
    query = (
        select(trial.number, link_.sequence_name, link_.reused, *columns_of(models.Run, StoredRun))
        .join(link_, link_.trial_id == trial.id)
        .join(models.Run, models.Run.id == link_.run_id)
        .where(condition)
        .order_by(trial.number, link_.sequence_name, link_.kind, link_.index)
    )
    return [TrialRun(row[0], row[1], StoredRun(*row[3:]), row[2]) for row in read_rows(database, query)]


def log(database: Database, key: str) -> str:
    """Return the end of what a run printed; empty where no such run is stored."""
    query = select(models.RunOutput.log).join(models.Run, models.Run.id == models.RunOutput.run_id)
    return read(database, lambda session: session.scalar(query.where(models.Run.key == key)) or "")


def digest_of(trajectory: "Trajectory") -> str:
    """Return the hex SHA-256 of the numbers and names of a trajectory, whatever compression stores it."""
    total = hashlib.sha256()
    for numbers in (trajectory.timestamps, trajectory.positions, trajectory.quaternions):
        total.update(numbers.astype("<f8").tobytes())
    total.update(trajectory.frame_ids.astype("<i8").tobytes())
    total.update("\0".join(trajectory.names).encode("utf-8", "surrogatepass"))
    return total.hexdigest()


def trajectories(database: Database, keys: Sequence[str]) -> dict[str, "Trajectory"]:
    """Return the trajectory of each run that is stored under one of these keys; those of failed runs are empty.

    Raises
    ------
    StorageError
        A trajectory is not the one that was stored; the message names the run.
    """
    found: dict[str, Trajectory] = {}
    for some in chunks(keys):
        query = (
            select(models.Run.key, models.Run.trajectory_digest, models.RunOutput.trajectory)
            .join(models.RunOutput, models.RunOutput.run_id == models.Run.id)
            .where(models.Run.key.in_(some))
        )
        for key, digest, data in read_rows(database, query):
            found[key] = checked_trajectory(key, digest, data)
    return found


def checked_trajectory(key: str, digest: str, data: bytes) -> "Trajectory":
    """Return the trajectory that these bytes hold, or raise `StorageError` where it is not the one that was stored."""
    from gtf_tune.trajectory import from_bytes

    damaged = f"the stored trajectory of run {key} is damaged"
    advice = "restore a backup, or delete the study and run it again"
    try:
        trajectory = from_bytes(data)
    except TrajectoryError as error:
        raise StorageError(f"{damaged} ({error}); {advice}") from error
    if digest_of(trajectory) != digest:
        raise StorageError(f"{damaged} (its digest differs); {advice}")
    return trajectory
