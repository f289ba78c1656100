"""Store the side metric against ground truth, apart from everything that searches."""

from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

from sqlalchemy import delete, select
from sqlalchemy.orm import Session

from gtf_tune.store.database import Database, models
from gtf_tune.store.database.session import columns_of, read_rows, write


@dataclass(frozen=True)
class Validation:
    """The error against ground truth of one trial on one sequence, None where it could not be computed.

    ``metrics`` says which error it is (``metric``, ``unit``, ``definition``), of which runs, and what went wrong.
    """

    sequence_name: str
    value: float | None
    metrics: Mapping[str, Any] = field(default_factory=dict)

    @property
    def ate(self) -> float | None:
        """Return the value if it is an ATE; rows that do not say what they are hold one."""
        return self.value if self.metrics.get("metric", "ate") == "ate" else None


def save(database: Database, trial_id: int, validations: Sequence[Validation]) -> None:
    """Store the side metrics of a trial, in place of earlier ones."""

    def work(session: Session) -> None:
        session.execute(delete(models.Validation).where(models.Validation.trial_id == trial_id))
        for validation in validations:
            values = {
                "sequence_name": validation.sequence_name,
                "value": validation.value,
                "metrics": dict(validation.metrics),
            }
            session.add(models.Validation(trial_id=trial_id, **values))

    write(database, work)


def of_study(database: Database, study_id: int, numbers: Collection[int] | None = None) -> dict[int, list[Validation]]:
    """Return the side metrics of a study by the number of the trial; trials without any are absent.

    ``numbers`` are the trials to look at, all where there are none given.
    """
    query = (
        select(models.Trial.number, *columns_of(models.Validation, Validation))
        .join(models.Trial, models.Trial.id == models.Validation.trial_id)
        .where(models.Trial.study_id == study_id)
        .order_by(models.Trial.number, models.Validation.sequence_name)
    )
    if numbers is not None:
        query = query.where(models.Trial.number.in_(numbers))
    found: dict[int, list[Validation]] = {}
    for number, *columns in read_rows(database, query):
        found.setdefault(number, []).append(Validation(*columns))
    return found


def values(database: Database, study_id: int) -> dict[int, dict[str, float | None]]:
    """Return the side metric of each sequence by the number of the trial, without its details; see `of_study`."""
    query = (
        select(models.Trial.number, models.Validation.sequence_name, models.Validation.value)
        .join(models.Trial, models.Trial.id == models.Validation.trial_id)
        .where(models.Trial.study_id == study_id)
        .order_by(models.Trial.number, models.Validation.sequence_name)
    )
    found: dict[int, dict[str, float | None]] = {}
    for number, name, value in read_rows(database, query):
        found.setdefault(number, {})[name] = value
    return found
