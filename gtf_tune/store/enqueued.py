"""Append trials to a study: with options that a user gave, or from Optuna's own queue."""

import uuid
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from sqlalchemy import String, cast, func, select
from sqlalchemy.orm import Session

from gtf_tune.pipelines.options import OptionValue
from gtf_tune.store.database import Database, models
from gtf_tune.store.database.columns import DatabaseClock
from gtf_tune.store.database.session import read_rows, write
from gtf_tune.store.optuna.rows import NUMBER_KEY, TRIAL_ATTRIBUTES, TRIALS
from gtf_tune.store.studies import Study, locked
from gtf_tune.store.trial_queue import ENQUEUED_KEY, TrialResult


@dataclass(frozen=True)
class WaitingTrial:
    """Trial that waits in Optuna's queue, by its id and its number there."""

    id: int
    number: int


def enqueued_numbers(database: Database, study_id: int) -> tuple[int, ...]:
    """Return the numbers of the enqueued trials of a study, in ascending order."""
    ((resolved,),) = read_rows(database, select(models.Study.resolved).where(models.Study.id == study_id))
    return numbers_of(resolved)


def numbers_of(resolved: Mapping[str, Any]) -> tuple[int, ...]:
    """Return the numbers of the enqueued trials among what a study was resolved to."""
    return tuple(resolved.get(ENQUEUED_KEY, ()))


def append(database: Database, study_id: int, options: Mapping[str, OptionValue]) -> int:
    """Append a trial with these options, open the study if it was done, and return the number of the trial."""
    mark = f"enqueued {uuid.uuid4().hex}"  # identifies the row of this call if the answer to its commit is lost

    def work(session: Session) -> int:
        known = session.scalar(select(models.Trial.number).where(models.Trial.owner == mark))
        return _append(session, study_id, owner=mark, options=dict(options)) if known is None else known

    return write(database, work)


def adopt(database: Database, study_id: int, waiting: WaitingTrial) -> None:
    """Append a trial that waits in Optuna's queue; nothing happens where another worker has done so already."""

    def work(session: Session) -> None:
        locked(session, study_id)
        trial = models.Trial
        known = select(trial.id).where(trial.study_id == study_id, trial.optuna_trial_id == waiting.id)
        if session.scalar(known) is None:
            _append(session, study_id, optuna_trial_id=waiting.id, optuna_number=waiting.number)

    write(database, work)


def waiting_in_optuna(database: Database, study: Study) -> list[WaitingTrial]:
    """Return the trials that an Optuna user has enqueued and no worker has adopted yet, by number."""
    theirs, ours = TRIALS.c, models.Trial
    attribute = TRIAL_ATTRIBUTES.c
    numbered = select(attribute.trial_id).where(attribute.trial_id == theirs.trial_id, attribute.key == NUMBER_KEY)
    adopted = select(ours.id).where(ours.study_id == study.id, ours.optuna_trial_id == theirs.trial_id)
    query = (
        select(theirs.trial_id, theirs.number)
        .where(theirs.study_id == study.optuna_study_id, cast(theirs.state, String) == "WAITING")
        .where(~numbered.exists(), ~adopted.exists())
        .order_by(theirs.number)
    )
    return [WaitingTrial(*row) for row in read_rows(database, query)]


def _append(session: Session, study_id: int, **values: Any) -> int:
    study = locked(session, study_id)
    last = session.scalar(select(func.max(models.Trial.number)).where(models.Trial.study_id == study_id))
    if last is None:
        session.add(_row(study_id, 0))  # nominal, with which all others are compared
        last = 0
    session.add(_row(study_id, last + 1, **values))
    study.resolved = {**study.resolved, ENQUEUED_KEY: [*numbers_of(study.resolved), last + 1]}
    study.state = "open" if study.state == "done" else study.state
    return last + 1


def _row(study_id: int, number: int, **values: Any) -> models.Trial:
    """Return a trial that no worker has leased yet."""
    nobody = {"owner": "", "host": "", "machine": "", "pid": 0, "pid_started": 0, "attempts": 0}
    results = {**vars(TrialResult("failed")), "state": "claimed", "started_at": DatabaseClock()}
    return models.Trial(study_id=study_id, number=number, **{**nobody, **results, **values})
