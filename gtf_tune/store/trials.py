"""Read trials: all of a study, the nominal one, the best one."""

from collections.abc import Collection, Mapping
from dataclasses import dataclass
from typing import Any, Literal

from sqlalchemy import Executable, Select, String, Text, case, cast, func, select, type_coerce

from gtf_tune.errors import StorageError
from gtf_tune.pipelines.options import OptionValue
from gtf_tune.store.database import Database, models
from gtf_tune.store.database.session import chunks, columns_of, read_rows
from gtf_tune.store.optuna.rows import TRIALS
from gtf_tune.store.trial_queue import TrialState


@dataclass(frozen=True)
class Trial:
    """Stored trial without its matrices; what is measured is None until it is complete.

    ``number`` counts the trials of the study from 0, the nominal trial; ``optuna_number`` is Optuna's. Times are in
    seconds since 1970 UTC by the database's clock.
    """

    id: int
    study_id: int
    number: int
    optuna_trial_id: int | None
    optuna_number: int | None
    state: TrialState
    attempts: int
    owner: str
    host: str
    heartbeat_at: float | None
    options: Mapping[str, OptionValue] | None
    value: float | None
    feasible: bool | None
    gtf_ate: float | None
    standard_error: float | None
    ci_low: float | None
    ci_high: float | None
    coverage: float | None
    collapsed_rate: float | None
    clean_runs: int
    noisy_runs: int
    wall_s: float
    started_at: float
    finished_at: float | None
    message: str

    @property
    def unfinished(self) -> Literal["running", "interrupted", "waiting", ""]:
        """Return what is the matter with a trial that has not ended, in one word; empty for one that has."""
        if self.state != "claimed":
            return ""
        if self.heartbeat_at is not None:
            return "running"
        return "interrupted" if self.attempts else "waiting"

    def as_dict(self) -> dict[str, Any]:
        """Return the fields by the names that are stored and printed, where the number is called ``ordinal``."""
        return {"ordinal" if name == "number" else name: value for name, value in vars(self).items()}


@dataclass(frozen=True)
class Effort:
    """Count of the trials of a study that ended in one way with one number of runs."""

    state: TrialState
    feasible: bool | None
    clean_runs: int
    noisy_runs: int
    count: int = 1


def of_study(database: Database, study_id: int) -> list[Trial]:
    """Return all trials of a study by number."""
    return _read(database, _of(study_id).order_by(models.Trial.number))


def get(database: Database, study_id: int, number: int) -> Trial:
    """Return the trial of this number.

    Raises
    ------
    StorageError
        No worker has begun it yet.
    """
    found = _read(database, _of(study_id).where(models.Trial.number == number))
    if not found:
        raise StorageError(
            f"the study has no trial {number} in {database.shown_url}; see which it has", remedy=("show",)
        )
    return found[0]


def nominal(database: Database, study_id: int) -> Trial | None:
    """Return trial 0, or None before a worker has begun it."""
    return numbered(database, study_id, 0)


def numbered(database: Database, study_id: int, number: int) -> Trial | None:
    """Return the trial of this number, or None where there is none."""
    found = _read(database, _of(study_id).where(models.Trial.number == number))
    return found[0] if found else None


def ranked(database: Database, study_id: int, limit: int) -> list[Trial]:
    """Return the first trials of a study: feasible ones before others, complete ones before others, best ones first."""
    trial = models.Trial
    order = (
        case((trial.feasible.is_(True), 0), else_=1),
        case((trial.state == "complete", 0), else_=1),
        case((trial.value.is_(None), 1), else_=0),
        trial.value,
        trial.number,
    )
    return _read(database, _of(study_id).order_by(*order).limit(limit))


def efforts(database: Database, study_id: int) -> list[Effort]:
    """Return how the trials of a study ended and with how many runs, counted by one query."""
    trial = models.Trial
    groups = (trial.state, trial.feasible, trial.clean_runs, trial.noisy_runs)
    query = select(*groups, func.count()).where(trial.study_id == study_id).group_by(*groups)
    return [Effort(*row) for row in read_rows(database, query)]


def option_names(database: Database, study_id: int) -> list[str]:
    """Return the names of the searched options, in the order of the first trial that has any."""
    trial = models.Trial
    query = select(trial.options).where(trial.study_id == study_id, trial.options.is_not(None))
    return next((list(row[0]) for row in read_rows(database, query.order_by(trial.number).limit(1))), [])


def best(database: Database, study_id: int, before: int | None = None) -> Trial | None:
    """Return the feasible complete trial of the smallest value, the first of equals, or None before there is one.

    ``before`` leaves out the trials from that number on.
    """
    trial = models.Trial
    query = _of(study_id).where(trial.state == "complete", trial.feasible.is_(True), trial.value.is_not(None))
    if before is not None:
        query = query.where(trial.number < before)
    found = _read(database, query.order_by(trial.value, trial.number).limit(1))
    return found[0] if found else None


def details(database: Database, trial_ids: list[int]) -> dict[int, Mapping[str, Any]]:
    """Return the matrices that were stored with each trial."""
    query = select(models.Trial.id, models.Trial.detail)
    return {
        row[0]: row[1]
        for some in chunks(trial_ids)
        for row in read_rows(database, query.where(models.Trial.id.in_(some)))
    }


MADE_BY_KEY = "made_by"
"""Where the detail of a trial says which versions and which definition made its score."""


def version_mismatches(database: Database, study_id: int, numbers: Collection[int] | None = None) -> dict[int, str]:
    """Return how the pipeline that made a trial differs from the one that its study began with, by number.

    Trials of the same version are absent. ``numbers`` are the trials to look at, all where there are none given.
    """
    trial = models.Trial
    noted = type_coerce(trial.detail, Text).contains('"version_mismatch":', autoescape=True)
    query = select(trial.number, trial.detail).where(trial.study_id == study_id, noted)
    if numbers is not None:
        query = query.where(trial.number.in_(numbers))
    return {number: detail["version_mismatch"] for number, detail in read_rows(database, query)}


def counts(database: Database, study_id: int) -> dict[TrialState, int]:
    """Return how many trials of a study are in each state; states without a trial are absent."""
    trial = models.Trial
    query = select(trial.state, func.count()).where(trial.study_id == study_id).group_by(trial.state)
    return {row[0]: row[1] for row in read_rows(database, query)}


def untold(database: Database, study_id: int) -> list[Trial]:
    """Return finished trials whose end Optuna has not been told: their worker died between the two."""
    running = select(TRIALS.c.trial_id).where(cast(TRIALS.c.state, String) == "RUNNING")
    trial = models.Trial
    return _read(database, _of(study_id).where(trial.state != "claimed", trial.optuna_trial_id.in_(running)))


def _of(study_id: int) -> Select[*tuple[Any, ...]]:
    return select(*columns_of(models.Trial, Trial)).where(models.Trial.study_id == study_id)


def _read(database: Database, query: Executable) -> list[Trial]:
    return [Trial(*row) for row in read_rows(database, query)]
