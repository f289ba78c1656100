"""Hand out the slots of a study's budget, each to one live worker at a time.

A slot is one trial of the budget. A worker owns it by a token that every later step compares, so that a worker that was
cut off and came back cannot touch a slot that another one took over.
"""

import uuid
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any, Literal

from sqlalchemy import ColumnElement, func, or_, select, update
from sqlalchemy.orm import Session

from gtf_tune.pipelines.options import OptionValue
from gtf_tune.store.database import Database, models
from gtf_tune.store.database.clock import DatabaseClock
from gtf_tune.store.database.session import read, write
from gtf_tune.store.workers import Worker, has_died

TrialState = Literal["claimed", "complete", "pruned", "failed"]


@dataclass(frozen=True)
class Slot:
    """Hold the right of one worker to one slot of a study.

    ``optuna_trial_id`` and ``options`` are there where a former worker had asked Optuna already. ``attempts`` counts
    the workers that had the slot, this one included.
    """

    trial_id: int
    study_id: int
    ordinal: int
    claim: str
    attempts: int
    optuna_trial_id: int | None = None
    optuna_number: int | None = None
    options: Mapping[str, OptionValue] | None = None


@dataclass(frozen=True)
class TrialResult:
    """Hold how a trial ended.

    ``value`` is what Optuna is told, ``gtf_ate`` the score in its unit; both are None for a trial that failed.
    ``coverage`` and ``collapsed_rate`` lie in [0, 1]. ``detail`` holds the matrices of each sequence.
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


def claim_slot(database: Database, study_id: int, budget: int, worker: Worker) -> Slot | None:
    """Claim the next unused slot of a study, or return None where there is none for now.

    There is none once all ``budget`` slots are handed out, nor while somebody works on slot 0: all others are measured
    against the nominal trial.
    """
    claim = uuid.uuid4().hex

    def work(session: Session) -> Slot | None:
        mine = _held(session, claim)
        if mine is not None:
            return mine
        # Claims of one study wait for each other here, so that ordinals have no gaps and no worker overshoots.
        session.execute(select(models.Study.id).where(models.Study.id == study_id).with_for_update(key_share=True))
        ordinal, nominal_in_work = _next_ordinal(session, study_id)
        free = ordinal < budget and not nominal_in_work
        return _insert(session, study_id, ordinal, claim, worker) if free else None

    return write(database, work)


def _next_ordinal(session: Session, study_id: int) -> tuple[int, bool]:
    """Return the first ordinal that nobody has taken, and whether the nominal trial is in work."""
    trial = models.Trial
    last = select(func.max(trial.ordinal)).where(trial.study_id == study_id).scalar_subquery()
    nominal = select(trial.state).where(trial.study_id == study_id, trial.ordinal == 0).scalar_subquery()
    highest, state = session.execute(select(last, nominal)).one()
    return 0 if highest is None else highest + 1, state == "claimed"


def _insert(session: Session, study_id: int, ordinal: int, claim: str, worker: Worker) -> Slot:
    results = {**vars(TrialResult("failed")), "state": "claimed", "started_at": DatabaseClock()}
    row = models.Trial(study_id=study_id, ordinal=ordinal, attempts=1, **results, **_owned(claim, worker))
    session.add(row)
    session.flush()
    return Slot(row.id, study_id, ordinal, claim, attempts=1)


def adopt_stale(database: Database, study_id: int, worker: Worker, grace_s: float) -> Slot | None:
    """Take over the first slot whose worker is gone, or return None where there is no such slot.

    A worker is gone when it released the slot, when its process on this machine ended, or when its heartbeat is more
    than ``grace_s`` seconds away by the database's clock.
    """
    claim = uuid.uuid4().hex

    def work(session: Session) -> Slot | None:
        for trial_id, held_by in _stale(session, study_id, grace_s):
            unchanged = models.Trial.claim.is_not_distinct_from(held_by)
            values = {**_owned(claim, worker), "attempts": models.Trial.attempts + 1}
            if _update(session, trial_id, unchanged, values):
                break
        return _held(session, claim)

    return write(database, work)


def _stale(session: Session, study_id: int, grace_s: float) -> list[tuple[int, str | None]]:
    trial = models.Trial
    # A heartbeat from the future is as stale as an old one: the database's clock was set back after its worker died.
    silent = or_(trial.claim.is_(None), func.abs(DatabaseClock() - trial.heartbeat_at) > grace_s)
    query = (
        select(trial.id, trial.claim, silent, trial.owner, trial.host, trial.machine, trial.pid, trial.pid_started)
        .where(trial.study_id == study_id, trial.state == "claimed")
        .order_by(trial.ordinal)
    )
    return [(row[0], row[1]) for row in session.execute(query) if row[2] or has_died(Worker(*row[3:]))]


def beat(database: Database, slot: Slot) -> bool:
    """Record that the worker lives; return False where the slot is no longer its own."""
    return _change(database, slot, {"heartbeat_at": DatabaseClock()})


def attach_optuna_trial(
    database: Database, slot: Slot, trial_id: int, number: int, options: Mapping[str, OptionValue]
) -> bool:
    """Note which Optuna trial and options the slot works on; return False where the slot is no longer the worker's."""
    return _change(database, slot, {"optuna_trial_id": trial_id, "optuna_number": number, "options": dict(options)})


def release(database: Database, slot: Slot) -> bool:
    """Give an unfinished slot back, with its Optuna trial, to whoever adopts it first."""
    return _change(database, slot, {"claim": None, "heartbeat_at": None})


def finish(database: Database, slot: Slot, result: TrialResult) -> bool:
    """Store the result of a slot; return False, and store nothing, where the slot is no longer the worker's."""

    def work(session: Session) -> bool:
        values = {**vars(result), "detail": dict(result.detail), "finished_at": DatabaseClock()}
        return _update(session, slot.trial_id, models.Trial.claim == slot.claim, values) or _finished(session, slot)

    return write(database, work)


def _finished(session: Session, slot: Slot) -> bool:
    """Tell whether this very claim finished the slot: the answer to an earlier commit may have been lost."""
    query = select(models.Trial.claim).where(models.Trial.id == slot.trial_id, models.Trial.state != "claimed")
    return session.scalar(query) == slot.claim


def owns(database: Database, slot: Slot) -> bool:
    """Tell whether the slot is still the worker's."""
    return read(database, lambda session: _held(session, slot.claim)) is not None


def _change(database: Database, slot: Slot, values: Mapping[str, Any]) -> bool:
    return write(database, lambda session: _update(session, slot.trial_id, models.Trial.claim == slot.claim, values))


def _update(session: Session, trial_id: int, condition: ColumnElement[bool], values: Mapping[str, Any]) -> bool:
    statement = (
        update(models.Trial)
        .where(models.Trial.id == trial_id, models.Trial.state == "claimed", condition)
        .values(**values)
        .returning(models.Trial.id)
    )
    return session.scalar(statement) is not None


def _held(session: Session, claim: str) -> Slot | None:
    trial = models.Trial
    query = select(
        trial.id,
        trial.study_id,
        trial.ordinal,
        trial.claim,
        trial.attempts,
        trial.optuna_trial_id,
        trial.optuna_number,
        trial.options,
    ).where(trial.claim == claim, trial.state == "claimed")
    row = session.execute(query).one_or_none()
    return None if row is None else Slot(*row)


def _owned(claim: str, worker: Worker) -> dict[str, Any]:
    return {
        "claim": claim,
        "owner": worker.name,
        "host": worker.host,
        "machine": worker.machine,
        "pid": worker.pid,
        "pid_started": worker.pid_started,
        "heartbeat_at": DatabaseClock(),
    }
