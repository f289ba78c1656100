"""Hand out the trials of a study's budget, each to one live worker at a time.

A worker is one process, and whether it is alive is known on its own machine. It leases a trial and holds the token of
that lease, which every later step compares: a worker that was cut off and came back cannot change a trial that another
one has taken over.
"""

import os
import socket
import uuid
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any, Literal

from sqlalchemy import ColumnElement, and_, case, func, or_, select, update
from sqlalchemy.orm import Session, aliased

from gtf_tune.operating_system import machine_name, process_start
from gtf_tune.pipelines.options import OptionValue
from gtf_tune.store.database import Database, models
from gtf_tune.store.database.columns import DatabaseClock
from gtf_tune.store.database.session import read, read_rows, write


@dataclass(frozen=True)
class Worker:
    """Identify one process.

    ``machine`` names one boot of one machine and one process namespace, so that process numbers are only compared where
    they mean the same. ``pid_started`` counts clock ticks since that boot, which no change of the clock moves.
    """

    name: str
    host: str
    machine: str
    pid: int
    pid_started: int


def this_worker(name: str = "") -> Worker:
    """Return the worker that this process is; the name defaults to ``HOST:PID``."""
    host, pid = socket.gethostname(), os.getpid()
    return Worker(name or f"{host}:{pid}", host, machine_name(), pid, process_start(pid) or 0)


def has_died(worker: Worker) -> bool:
    """Return True if a worker's process is known to be gone; False where this machine cannot know."""
    if worker.machine != machine_name():
        return False
    started = process_start(worker.pid)
    return started is None or (started != 0 and started != worker.pid_started)


TrialState = Literal["claimed", "complete", "pruned", "failed"]

ENQUEUED_KEY = "enqueued"
"""Where ``resolved`` of a study keeps the numbers of its enqueued trials, which the budget of the search leaves out."""


@dataclass(frozen=True)
class TrialLease:
    """Right of one worker to work on one trial of a study.

    ``number`` counts the trials of the study from 0, the nominal trial. ``optuna_trial_id`` and ``options`` are set
    where an earlier worker has asked Optuna already. ``attempts`` counts the workers that have leased the trial, this
    one included. ``set_aside`` says why an earlier worker has left it to another machine; empty where none has.
    """

    trial_id: int
    study_id: int
    number: int
    token: str
    attempts: int
    optuna_trial_id: int | None = None
    optuna_number: int | None = None
    options: Mapping[str, OptionValue] | None = None
    set_aside: str = ""


SET_ASIDE_S = 30.0
"""Seconds for which a trial that was set aside is left to workers of other hosts: they look at least every 10 s."""


@dataclass(frozen=True)
class TrialResult:
    """Outcome of a trial.

    ``value`` is what Optuna minimises, ``gtf_ate`` the score in its unit; both are None for a trial that failed.
    ``coverage`` and ``collapsed_rate`` lie in [0, 1]. ``detail`` contains the matrices of each sequence.
    """

    state: Literal["complete", "pruned", "failed"]
    value: float | None = None
    feasible: bool | None = None
    gtf_ate: float | None = None
    standard_error: float | None = None
    ci_low: float | None = None
    ci_high: float | None = None
    coverage: float | None = None
    collapsed_rate: float | None = None
    clean_runs: int = 0
    noisy_runs: int = 0
    wall_s: float = 0.0
    message: str = ""
    detail: Mapping[str, Any] = field(default_factory=dict)


def lease_trial(database: Database, study_id: int, budget: int, worker: Worker) -> TrialLease | None:
    """Lease the next trial of a study that nobody has begun; return None where there is none for now.

    There is none once all ``budget`` trials are handed out besides those that were enqueued, nor while a worker holds
    trial 0: all others are compared with the nominal trial.
    """
    token = uuid.uuid4().hex

    def work(session: Session) -> TrialLease | None:
        mine = _held(session, token)
        if mine is not None:
            return mine
        # Workers of one study wait for each other here, so that numbers have no gaps and nobody exceeds the budget.
        resolved = session.scalar(
            select(models.Study.resolved).where(models.Study.id == study_id).with_for_update(key_share=True)
        )
        number, nominal_in_work = _next_number(session, study_id)
        free = number < budget + len((resolved or {}).get(ENQUEUED_KEY, ())) and not nominal_in_work
        return _insert(session, study_id, number, token, worker) if free else None

    return write(database, work)


def _next_number(session: Session, study_id: int) -> tuple[int, bool]:
    """Return the first number that nobody has taken, and whether the nominal trial is in work."""
    trial = models.Trial
    last = select(func.max(trial.number)).where(trial.study_id == study_id).scalar_subquery()
    nominal = select(trial.state).where(trial.study_id == study_id, trial.number == 0).scalar_subquery()
    highest, state = session.execute(select(last, nominal)).one()
    return 0 if highest is None else highest + 1, state == "claimed"


def _insert(session: Session, study_id: int, number: int, token: str, worker: Worker) -> TrialLease:
    results = {**vars(TrialResult("failed")), "state": "claimed", "started_at": DatabaseClock()}
    row = models.Trial(study_id=study_id, number=number, attempts=1, **results, **_leased(token, worker))
    session.add(row)
    session.flush()
    return TrialLease(row.id, study_id, number, token, attempts=1)


def adopt_stale(database: Database, study_id: int, worker: Worker, grace_s: float) -> TrialLease | None:
    """Lease the first trial whose worker is gone; return None where there is no such trial.

    A worker is gone when it released the trial, when its process on this machine ended, or when its last heartbeat is
    more than ``grace_s`` seconds away by the database's clock. An enqueued trial never had one; it waits until the
    nominal trial has ended.
    """
    token = uuid.uuid4().hex

    def work(session: Session) -> TrialLease | None:
        for trial_id, held_by in _stale(session, study_id, worker.host, grace_s):
            unchanged = models.Trial.lease.is_not_distinct_from(held_by)
            values = {**_leased(token, worker), "attempts": models.Trial.attempts + 1, "started_at": _started_at()}
            if _update(session, trial_id, unchanged, values):
                break
        return _held(session, token)

    return write(database, work)


def _started_at() -> Any:
    return case((models.Trial.attempts == 0, DatabaseClock()), else_=models.Trial.started_at)


def _stale(session: Session, study_id: int, host: str, grace_s: float) -> list[tuple[int, str | None]]:
    trial = models.Trial
    nominal = aliased(trial)
    in_work = select(nominal.id).where(nominal.study_id == study_id, nominal.number == 0, nominal.state == "claimed")
    # A heartbeat from the future is as stale as an old one: the database's clock was set back after its worker died.
    silence_s = func.abs(DatabaseClock() - trial.heartbeat_at)
    silent = or_(trial.lease.is_(None), silence_s > grace_s)
    elsewhere = and_(trial.lease.is_(None), trial.host == host, func.coalesce(silence_s, SET_ASIDE_S) < SET_ASIDE_S)
    query = (
        select(trial.id, trial.lease, silent, trial.owner, trial.host, trial.machine, trial.pid, trial.pid_started)
        .where(trial.study_id == study_id, trial.state == "claimed", or_(trial.number == 0, ~in_work.exists()))
        .where(~elsewhere)
        .order_by(trial.number)
    )
    return [(row[0], row[1]) for row in session.execute(query) if row[2] or has_died(Worker(*row[3:]))]


@dataclass(frozen=True)
class ActiveWorker:
    """A process that holds trials of a study, and the seconds since it was last heard of, by the database's clock."""

    name: str
    host: str
    numbers: tuple[int, ...]
    silent_s: float


def active_workers(database: Database, study_id: int) -> list[ActiveWorker]:
    """Return the workers that hold trials of a study, by name."""
    trial = models.Trial
    query = (
        select(trial.owner, trial.host, trial.number, DatabaseClock() - trial.heartbeat_at)
        .where(trial.study_id == study_id, trial.state == "claimed", trial.lease.is_not(None))
        .order_by(trial.owner, trial.number)
    )
    by_name: dict[tuple[str, str], list[tuple[int, float]]] = {}
    for name, host, number, silent_s in read_rows(database, query):
        by_name.setdefault((name, host), []).append((number, float(silent_s)))
    return [
        ActiveWorker(name, host, tuple(number for number, _ in held), min(silent_s for _, silent_s in held))
        for (name, host), held in by_name.items()
    ]


def renew(database: Database, lease: TrialLease) -> bool:
    """Record that the worker is alive; return False where another one has taken the trial over."""
    return _change(database, lease, {"heartbeat_at": DatabaseClock()})


def attach_optuna_trial(
    database: Database, lease: TrialLease, trial_id: int, number: int, options: Mapping[str, OptionValue]
) -> bool:
    """Store the Optuna trial and the options of a leased trial; return False where the lease is lost."""
    return _change(database, lease, {"optuna_trial_id": trial_id, "optuna_number": number, "options": dict(options)})


def release(database: Database, lease: TrialLease) -> bool:
    """Give an unfinished trial back, with its Optuna trial, to the first worker that adopts it."""
    return _change(database, lease, {"lease": None, "heartbeat_at": None})


def set_aside(database: Database, lease: TrialLease, reason: str) -> bool:
    """Give an unfinished trial back, for another host to begin it: this one waits `SET_ASIDE_S` before it does."""
    return _change(database, lease, {"lease": None, "heartbeat_at": DatabaseClock(), "message": reason})


def finish(database: Database, lease: TrialLease, result: TrialResult) -> bool:
    """Store the result of a leased trial; return False, and store nothing, where the lease is lost."""

    def work(session: Session) -> bool:
        values = {**vars(result), "detail": dict(result.detail), "finished_at": DatabaseClock()}
        return _update(session, lease.trial_id, models.Trial.lease == lease.token, values) or _finished(session, lease)

    return write(database, work)


def _finished(session: Session, lease: TrialLease) -> bool:
    """Return True if this very lease finished the trial: the answer to an earlier commit may have been lost."""
    query = select(models.Trial.lease).where(models.Trial.id == lease.trial_id, models.Trial.state != "claimed")
    return session.scalar(query) == lease.token


def is_held(database: Database, lease: TrialLease) -> bool:
    """Return True if the worker still holds the lease."""
    return read(database, lambda session: _held(session, lease.token)) is not None


def _change(database: Database, lease: TrialLease, values: Mapping[str, Any]) -> bool:
    unchanged = models.Trial.lease == lease.token
    return write(database, lambda session: _update(session, lease.trial_id, unchanged, values))


def _update(session: Session, trial_id: int, condition: ColumnElement[bool], values: Mapping[str, Any]) -> bool:
    statement = (
        update(models.Trial)
        .where(models.Trial.id == trial_id, models.Trial.state == "claimed", condition)
        .values(**values)
        .returning(models.Trial.id)
    )
    return session.scalar(statement) is not None


def _held(session: Session, token: str) -> TrialLease | None:
    trial = models.Trial
    query = select(
        trial.id,
        trial.study_id,
        trial.number,
        trial.lease,
        trial.attempts,
        trial.optuna_trial_id,
        trial.optuna_number,
        trial.options,
        trial.message,
    ).where(trial.lease == token, trial.state == "claimed")
    row = session.execute(query).one_or_none()
    return None if row is None else TrialLease(*row)


def _leased(token: str, worker: Worker) -> dict[str, Any]:
    return {
        "lease": token,
        "owner": worker.name,
        "host": worker.host,
        "machine": worker.machine,
        "pid": worker.pid,
        "pid_started": worker.pid_started,
        "heartbeat_at": DatabaseClock(),
    }
