"""Store re-evaluations of a study's best settings with fresh seeds."""

import time
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from sqlalchemy import select
from sqlalchemy.orm import Session

from gtf_tune.store.database import Database, models
from gtf_tune.store.database.session import columns_of, read_rows, write


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
    """Store a confirmation and return it."""
    new = Confirmation(time.time(), dict(definition), dict(result), verdict)

    def work(session: Session) -> Confirmation:
        row = models.Confirmation
        if session.scalar(select(row.id).where(row.study_id == study_id, row.created_at == new.created_at)) is None:
            session.add(row(study_id=study_id, **vars(new)))
        return new

    return write(database, work)


def of_study(database: Database, study_id: int) -> list[Confirmation]:
    """Return the confirmations of a study, oldest first."""
    query = select(*columns_of(models.Confirmation, Confirmation)).where(models.Confirmation.study_id == study_id)
    return [Confirmation(*row) for row in read_rows(database, query.order_by(models.Confirmation.id))]
