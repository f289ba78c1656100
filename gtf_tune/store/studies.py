"""Add, find, list and delete studies."""

import json
import time
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from typing import Any, Literal, cast

from sqlalchemy import case, delete, func, or_, select, update
from sqlalchemy.orm import Session

from gtf_tune.definition import StudyDefinition, definition_from_dict
from gtf_tune.errors import DefinitionError, DeletedError, StorageError, did_you_mean
from gtf_tune.store.database import Database, models
from gtf_tune.store.database.session import columns_of, read, read_rows, write
from gtf_tune.store.optuna.link import delete_linked
from gtf_tune.store.runs import of_machine

StudyState = Literal["open", "paused", "stopped", "done", "copying"]
"""Workers finish the trials of a paused study, and give back those of a stopped one; ``copying`` is a copy that is not
complete yet, or never became so."""


@dataclass(frozen=True)
class StudySequence:
    """One sequence as it looked when the study was created; ``path`` is relative to the study's root."""

    name: str
    path: str
    layout: str
    fingerprint: str
    num_frames: int
    width: int
    height: int
    camera: str
    has_ground_truth: bool
    info: Mapping[str, Any] = field(default_factory=dict)


@dataclass(frozen=True)
class NewStudy:
    """What a study starts with.

    ``definition`` is the canonical JSON of the definition, ``resolved`` what it was resolved to (noise of each
    sequence, versions, nominal options), ``root`` the folder that the paths of the sequences are relative to.
    """

    name: str
    optuna_study_id: int
    definition: str
    resolved: Mapping[str, Any]
    root: str
    sequences: tuple[StudySequence, ...]


@dataclass(frozen=True)
class Study:
    """A stored study; ``created_at`` is in seconds since 1970 UTC."""

    id: int
    name: str
    optuna_study_id: int
    state: StudyState
    created_at: float
    definition: str
    resolved: Mapping[str, Any]
    root: str


@dataclass(frozen=True)
class StudySummary:
    """One line of a list of studies; values are None where there is no such trial yet, or it is infeasible."""

    id: int
    name: str
    state: StudyState
    created_at: float
    trials: int
    claimed: int
    complete: int
    infeasible: int
    pruned: int
    failed: int
    best_value: float | None
    nominal_value: float | None
    wall_s: float
    last_finished_at: float | None
    definition: str

    @property
    def done(self) -> int:
        """Return the number of trials that have ended in whatever way, those that were stopped early among them."""
        return self.trials - self.claimed


def add(database: Database, new: NewStudy) -> Study:
    """Store a new study and its sequences, and return it.

    Raises
    ------
    StorageError
        A study of this name exists already; of several that add it at once, one succeeds.
    """
    created_at = time.time()

    def work(session: Session) -> Study:
        found = _find(session, new.name)
        if found is not None and found.created_at != created_at:
            raise name_is_taken(database, new.name)
        return found or _insert(session, new, created_at)

    return write(database, work)


def name_is_taken(database: Database, name: str) -> StorageError:
    """Return the error for whoever wants to add a study of a name that the database has."""
    return StorageError(
        f"study '{name}' exists already in {database.shown_url}; resume or delete it, or choose another name",
        remedy=("resume or delete", name),
    )


def _insert(session: Session, new: NewStudy, created_at: float) -> Study:
    row = models.Study(
        name=new.name,
        optuna_study_id=new.optuna_study_id,
        state="open",
        created_at=created_at,
        definition=new.definition,
        resolved=dict(new.resolved),
        root=new.root,
    )
    session.add(row)
    session.flush()
    for sequence in new.sequences:
        session.add(models.Sequence(study_id=row.id, **vars(sequence)))
    return Study(row.id, new.name, new.optuna_study_id, "open", created_at, new.definition, new.resolved, new.root)


def get(database: Database, name: str) -> Study:
    """Return the study of this name.

    Raises
    ------
    StorageError
        There is none; the message shows the nearest names.
    """
    found = read(database, lambda session: _find(session, name))
    if found is not None:
        return found
    hint = did_you_mean(name, names(database), most=3)
    raise StorageError(
        f"there is no study '{name}' in {database.shown_url}; {hint or 'list its studies'}",
        remedy=("list", database.shown_url),
    )


def stored_definition(study: Study | StudySummary) -> StudyDefinition:
    """Return the definition that is stored with a study.

    Raises
    ------
    DefinitionError
        The stored text is damaged, or a newer version wrote it.
    """
    source = f"study '{study.name}'"
    try:
        data = json.loads(study.definition)
    except ValueError as error:
        raise DefinitionError(
            f"{source}: its stored definition is damaged; check the storage", remedy=("check",)
        ) from error
    return definition_from_dict(data, source)


def names(database: Database) -> list[str]:
    """Return the names of all studies, oldest first."""
    return read(database, lambda session: list(session.scalars(select(models.Study.name).order_by(models.Study.id))))


def open_studies(database: Database) -> list[Study]:
    """Return the studies that workers may take up, oldest first."""
    query = select(*columns_of(models.Study, Study)).where(models.Study.state == "open").order_by(models.Study.id)
    return [Study(*row) for row in read_rows(database, query)]


def sequences(database: Database, study_id: int) -> list[StudySequence]:
    """Return the sequences of a study in the order of its definition."""
    query = (
        select(*columns_of(models.Sequence, StudySequence))
        .where(models.Sequence.study_id == study_id)
        .order_by(models.Sequence.id)
    )
    return [StudySequence(*row) for row in read_rows(database, query)]


def summaries(database: Database, study_id: int | None = None) -> list[StudySummary]:
    """Return one line for each study, or for one of them, oldest first, by one query."""
    trial, study = models.Trial, models.Study
    complete = trial.state == "complete"
    value = case((complete & trial.feasible.is_(True), trial.value))
    query = (
        select(
            study.id,
            study.name,
            study.state,
            study.created_at,
            func.count(trial.id),
            func.count(case((trial.state == "claimed", 1))),
            func.count(case((complete, 1))),
            func.count(case((complete & trial.feasible.is_(False), 1))),
            func.count(case((trial.state == "pruned", 1))),
            func.count(case((trial.state == "failed", 1))),
            func.min(value),
            func.min(case((trial.number == 0, value))),
            func.coalesce(func.sum(trial.wall_s), 0.0),
            func.max(trial.finished_at),
            study.definition,
        )
        .outerjoin(trial, trial.study_id == study.id)
        .where(*([] if study_id is None else [study.id == study_id]))
        .group_by(study.id)
        .order_by(study.id)
    )
    return [StudySummary(*row) for row in read_rows(database, query)]


def state(database: Database, study_id: int) -> StudyState:
    """Return the state of a study.

    Raises
    ------
    DeletedError
        Someone has deleted the study.
    """
    found = read_rows(database, select(models.Study.state).where(models.Study.id == study_id))
    if not found:
        raise DeletedError(
            f"the study was deleted from {database.shown_url} while it was worked on; nothing is left to do for it"
        )
    return cast(StudyState, found[0][0])


def of_id(database: Database, study_id: int) -> Study:
    """Return a study as it is now.

    Raises
    ------
    DeletedError
        Someone has deleted it.
    """
    found = read_rows(database, select(*columns_of(models.Study, Study)).where(models.Study.id == study_id))
    if not found:
        state(database, study_id)
    return Study(*found[0])


def set_state(database: Database, study_id: int, state: StudyState) -> None:
    """Open, pause or close a study; workers look before every trial."""
    _set(database, study_id, state=state)


def check_open(study: Study) -> None:
    """Raise `StorageError` unless a study may be worked on; one that is done may, and ends at once.

    Raises
    ------
    StorageError
        The study is paused, stopped, or an unfinished copy.
    """
    check_whole(study)
    if study.state not in ("open", "done"):
        raise StorageError(f"study '{study.name}' is {study.state}; resume it", remedy=("resume", study.name))


def check_whole(study: Study) -> None:
    """Raise `StorageError` for an unfinished copy of a study."""
    if study.state == "copying":
        raise StorageError(
            f"study '{study.name}' is an unfinished copy; delete it and copy it again", remedy=("delete", study.name)
        )


def close(database: Database, study: Study) -> bool:
    """Mark a study as done, and return whether it is marked.

    It is not where it was extended since ``study`` was read, or a trial was enqueued that nobody has begun.
    """
    same = (models.Study.id == study.id) & (models.Study.definition == study.definition)
    left = select(models.Trial.id).where(models.Trial.study_id == study.id, models.Trial.state == "claimed")
    statement = update(models.Study).where(same, ~left.exists()).values(state="done").returning(models.Study.id)
    return write(database, lambda session: session.scalar(statement) is not None)


def replace_definition(database: Database, study_id: int, definition: str) -> None:
    """Replace the definition of a study, and keep the former one among what the study was resolved to."""
    at = time.time()

    def work(session: Session) -> None:
        row = locked(session, study_id)
        if row.definition != definition:
            former = {"at": at, "before": json.loads(row.definition)}
            row.resolved = {**row.resolved, "extensions": [*row.resolved.get("extensions", ()), former]}
            row.definition = definition

    write(database, work)


def locked(session: Session, study_id: int) -> models.Study:
    """Return the row of a study, which nobody else changes until the transaction ends."""
    return session.scalars(select(models.Study).where(models.Study.id == study_id).with_for_update()).one()


NOISE_RUNS_KEY = "noise_runs"
"""Where ``resolved`` of a study keeps the keys of the runs by which its noise was measured: no trial has them."""


def note_noise_runs(database: Database, study_id: int, keys: Iterable[str]) -> None:
    """Store the keys of runs by which the noise of a study is measured, before they begin: they go with the study."""

    def work(session: Session) -> None:
        row = locked(session, study_id)
        known = {*row.resolved.get(NOISE_RUNS_KEY, ()), *keys}
        row.resolved = {**row.resolved, NOISE_RUNS_KEY: sorted(known)}

    write(database, work)


def resolve_noise(database: Database, study_id: int, sigmas: Mapping[str, float]) -> dict[str, float]:
    """Store the noise of sequences that have none yet, and return that of all: the first to store one decides it."""

    def work(session: Session) -> dict[str, float]:
        row = locked(session, study_id)
        found = {**sigmas, **row.resolved["noise_sigma"]}
        row.resolved = {**row.resolved, "noise_sigma": found}
        return found

    return write(database, work)


def delete_study(database: Database, name: str) -> None:
    """Delete a study, its Optuna study, its trials, and the runs that no other study uses, those that failed too.

    Optuna's part goes first, so that after an interruption the study is still there to be deleted again.
    """
    study = get(database, name)
    delete_linked(database, study)
    write(database, lambda session: _delete(session, study.id))


def _delete(session: Session, study_id: int) -> None:
    kept: set[str] = set()
    mine: set[str] = set()
    for owner, definition in session.execute(select(models.Confirmation.study_id, models.Confirmation.definition)):
        (mine if owner == study_id else kept).update(definition.get("run_keys", ()))
    for owner, resolved in session.execute(select(models.Study.id, models.Study.resolved)):
        (mine if owner == study_id else kept).update(resolved.get(NOISE_RUNS_KEY, ()))
    images = select(models.Sequence.fingerprint)
    own, others = images.where(models.Sequence.study_id == study_id), images.where(models.Sequence.study_id != study_id)
    spoiled = of_machine() & models.Run.sequence_fingerprint.in_(own) & models.Run.sequence_fingerprint.not_in(others)
    used = select(models.TrialRun.run_id).join(models.Trial, models.Trial.id == models.TrialRun.trial_id)
    here, elsewhere = used.where(models.Trial.study_id == study_id), used.where(models.Trial.study_id != study_id)
    for statement in (
        delete(models.Run).where(
            or_(models.Run.id.in_(here), models.Run.key.in_(mine - kept), spoiled),
            models.Run.id.not_in(elsewhere),
        ),
        delete(models.Study).where(models.Study.id == study_id),
    ):
        session.execute(statement.execution_options(synchronize_session=False))


def _set(database: Database, study_id: int, **values: Any) -> None:
    statement = update(models.Study).where(models.Study.id == study_id).values(**values)
    write(database, lambda session: session.execute(statement).close())


def _find(session: Session, name: str) -> Study | None:
    row = session.execute(select(*columns_of(models.Study, Study)).where(models.Study.name == name)).one_or_none()
    return None if row is None else Study(*row)
