"""Store re-evaluations of a study's best settings with fresh seeds."""

import time
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from sqlalchemy import select
from sqlalchemy.orm import Session

from gtf_tune.store.database import Database, models
from gtf_tune.store.database.session import columns_of, read_rows, write
from gtf_tune.store.studies import locked


@dataclass(frozen=True)
class Confirmation:
    """One confirmation: what was run, what came out, and the verdict in a word."""

    created_at: float
    definition: Mapping[str, Any]
    result: Mapping[str, Any]
    verdict: str


def add(
    database: Database, study_id: int, definition: Mapping[str, Any], result: Mapping[str, Any], verdict: str
) -> Confirmation:
    """Store a confirmation, unless the same one is stored, and return what is stored.

    It is the same where the same runs, seeds included, were asked for, whoever did so.
    """
    new = Confirmation(time.time(), dict(definition), dict(result), verdict)

    def work(session: Session) -> Confirmation:
        locked(session, study_id)
        row = models.Confirmation
        query = select(*columns_of(row, Confirmation)).where(row.study_id == study_id).order_by(row.id)
        stored = [Confirmation(*found) for found in session.execute(query)]
        same = next((one for one in stored if one.definition == new.definition), None)
        if same is None:
            session.add(row(study_id=study_id, **vars(new)))
        return same or new

    return write(database, work)


def of_study(database: Database, study_id: int) -> list[Confirmation]:
    """Return the confirmations of a study, oldest first."""
    query = select(*columns_of(models.Confirmation, Confirmation)).where(models.Confirmation.study_id == study_id)
    return [Confirmation(*row) for row in read_rows(database, query.order_by(models.Confirmation.id))]
