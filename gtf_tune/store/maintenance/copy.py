"""Copy a study with everything that belongs to it from one database to another."""

from collections.abc import Mapping
from contextlib import ExitStack
from dataclasses import replace
from typing import Any

from sqlalchemy import ColumnElement, Table, insert, select
from sqlalchemy.orm import Session

from gtf_tune.errors import StorageError
from gtf_tune.store import confirmations, studies
from gtf_tune.store.database import Database, models
from gtf_tune.store.database.engine import place_of
from gtf_tune.store.database.session import chunks, read, read_rows, write
from gtf_tune.store.maintenance.digest import study_digest
from gtf_tune.store.optuna.copy import copy_optuna_study, optuna_digest
from gtf_tune.store.optuna.link import create_optuna_study, optuna_study_id
from gtf_tune.store.runs import checked_trajectory, trajectories
from gtf_tune.store.studies import Study

Row = dict[str, Any]

_RUNS_AT_ONCE = 200
_TABLES = models.Base.metadata.tables
_STUDY, _SEQUENCE, _TRIAL = (_TABLES[f"gtf_{name}"] for name in ("study", "sequence", "trial"))
_RUN, _OUTPUT, _TRIAL_RUN = (_TABLES[f"gtf_{name}"] for name in ("run", "run_output", "trial_run"))
_VALIDATION, _CONFIRMATION = (_TABLES[f"gtf_{name}"] for name in ("validation", "confirmation"))
_RELEASED = {"claim": None, "heartbeat_at": None}


def copy_study(source: Database, target: Database, name: str) -> str:
    """Copy a study, its Optuna study and its runs, those of confirmations too; return the digest that both have.

    Trials in work become released ones in the copy. The files of artifacts stay where they are. What a copy that was
    killed left in the target is deleted first.

    Raises
    ------
    StorageError
        There is no such study, the target is the source or has one of this name, a trajectory is damaged, or the study
        changed while it was copied; the target then holds nothing of it but sound runs, perhaps.
    """
    _check_different(source, target)
    study = studies.get(source, name)
    _make_place(target, name)
    study = replace(study, optuna_study_id=optuna_study_id(source, study))
    optuna_id = create_optuna_study(target, name)
    new_id = _copy_study_row(source, target, study, optuna_id)
    with ExitStack() as undo:
        undo.callback(_undo, target, name)
        optuna_ids = copy_optuna_study(source, target, study.optuna_study_id, optuna_id)
        run_ids = _copy_runs(source, target, study.id)
        _copy_trials(source, target, (study.id, new_id), optuna_ids, run_ids)
        digest = _verified(source, target, study, optuna_id)
        undo.pop_all()
    studies.set_state(target, new_id, study.state)
    return digest


def _undo(target: Database, name: str) -> None:
    studies.delete_study(target, name)


def _check_different(source: Database, target: Database) -> None:
    if place_of(source.url) == place_of(target.url):
        raise StorageError(f"both storages are {source.shown_url}; give another one to copy to")


def _make_place(target: Database, name: str) -> None:
    """Delete an unfinished copy of a study, and raise `StorageError` if there is another study of its name."""
    if name not in studies.names(target):
        return
    if studies.get(target, name).state != "copying":
        raise StorageError(
            f"{target.shown_url} already holds a study '{name}'; copy to another storage, or delete that one first",
            remedy=("delete there", name, target.shown_url),
        )
    studies.delete_study(target, name)


def _copy_study_row(source: Database, target: Database, study: Study, optuna_id: int) -> int:
    """Insert the study in the state ``copying``, which no worker takes up, and return its id."""
    (row,) = _rows(source, _STUDY, _STUDY.c.id == study.id)
    sequences = _rows(source, _SEQUENCE, _SEQUENCE.c.study_id == study.id)

    def work(session: Session) -> int:
        begun = session.scalar(select(_STUDY.c.id).where(_STUDY.c.optuna_study_id == optuna_id))
        if begun is not None:
            return int(begun)
        (new_id,) = _insert(session, _STUDY, [{**row, "optuna_study_id": optuna_id, "state": "copying"}])
        _insert(session, _SEQUENCE, [{**sequence, "study_id": new_id} for sequence in sequences])
        return new_id

    return write(target, work)


def _copy_runs(source: Database, target: Database, study_id: int) -> dict[int, int]:
    """Copy the runs of a study that the target lacks, and return the new id of each run by its old one."""
    used = (
        select(_TRIAL_RUN.c.run_id)
        .join(_TRIAL, _TRIAL.c.id == _TRIAL_RUN.c.trial_id)
        .where(_TRIAL.c.study_id == study_id)
    )
    found = read_rows(source, select(_RUN.c.id, _RUN.c.key).where(_RUN.c.id.in_(used)))
    for keys in chunks(_confirmed_keys(source, study_id)):
        found += read_rows(source, select(_RUN.c.id, _RUN.c.key).where(_RUN.c.key.in_(keys)))
    new_ids: dict[int, int] = {}
    for some in chunks(dict.fromkeys(found), _RUNS_AT_ONCE):
        new_ids.update(_copy_some_runs(source, target, {key: old_id for old_id, key in some}))
    return new_ids


def _confirmed_keys(source: Database, study_id: int) -> list[str]:
    """Return the keys of the runs that confirmations made: no trial refers to them."""
    found = confirmations.of_study(source, study_id)
    return [key for one in found for key in one.definition.get("run_keys") or ()]


def _copy_some_runs(source: Database, target: Database, old_ids: Mapping[str, int]) -> dict[int, int]:
    runs = _rows(source, _RUN, _RUN.c.key.in_(old_ids))
    outputs = {row["run_id"]: row for row in _rows(source, _OUTPUT, _OUTPUT.c.run_id.in_(old_ids.values()))}
    for run in runs:
        checked_trajectory(run["key"], run["trajectory_digest"], outputs[run["id"]]["trajectory"])
    write(target, lambda session: _add_runs(session, runs, outputs))
    trajectories(target, list(old_ids))
    stored = select(_RUN.c.key, _RUN.c.id).where(_RUN.c.key.in_(old_ids))
    return {old_ids[key]: new_id for key, new_id in read_rows(target, stored)}


def _add_runs(session: Session, runs: list[Row], outputs: Mapping[int, Row]) -> None:
    known = set(session.scalars(select(_RUN.c.key).where(_RUN.c.key.in_([run["key"] for run in runs]))))
    missing = [run for run in runs if run["key"] not in known]
    new_ids = _insert(session, _RUN, missing)
    _insert(
        session, _OUTPUT, [{**outputs[run["id"]], "run_id": new} for run, new in zip(missing, new_ids, strict=True)]
    )


def _copy_trials(
    source: Database,
    target: Database,
    study: tuple[int, int],
    optuna_ids: Mapping[int, int],
    run_ids: Mapping[int, int],
) -> None:
    """Copy trials, their links to runs, their side metric, and the confirmations of a study, all or none."""
    old_study, new_study = study
    here = select(_TRIAL.c.id).where(_TRIAL.c.study_id == old_study)
    trials = _rows(source, _TRIAL, _TRIAL.c.study_id == old_study)
    links = _rows(source, _TRIAL_RUN, _TRIAL_RUN.c.trial_id.in_(here))
    validations = _rows(source, _VALIDATION, _VALIDATION.c.trial_id.in_(here))
    confirmations = _rows(source, _CONFIRMATION, _CONFIRMATION.c.study_id == old_study)

    def work(session: Session) -> None:
        if session.scalar(select(_TRIAL.c.id).where(_TRIAL.c.study_id == new_study).limit(1)) is not None:
            return
        copies = [_trial_copy(trial, new_study, optuna_ids) for trial in trials]
        ids = dict(zip((trial["id"] for trial in trials), _insert(session, _TRIAL, copies), strict=True))
        moved = [{**link, "trial_id": ids[link["trial_id"]], "run_id": run_ids[link["run_id"]]} for link in links]
        _insert(session, _TRIAL_RUN, moved)
        _insert(
            session,
            _VALIDATION,
            [{**validation, "trial_id": ids[validation["trial_id"]]} for validation in validations],
        )
        _insert(session, _CONFIRMATION, [{**confirmation, "study_id": new_study} for confirmation in confirmations])

    write(target, work)


def _trial_copy(row: Row, study_id: int, optuna_ids: Mapping[int, int]) -> Row:
    released = _RELEASED if row["state"] == "claimed" else {}
    return {**row, **released, "study_id": study_id, "optuna_trial_id": optuna_ids.get(row["optuna_number"])}


def _verified(source: Database, target: Database, study: Study, optuna_id: int) -> str:
    digest = study_digest(target, study.name)
    same = digest == study_digest(source, study.name)
    if not same or optuna_digest(target, optuna_id) != optuna_digest(source, study.optuna_study_id):
        raise StorageError(
            f"study '{study.name}' changed while it was copied; pause it, then copy it again",
            remedy=("pause", study.name),
        )
    return digest


def _rows(database: Database, table: Table, condition: ColumnElement[bool]) -> list[Row]:
    query = select(table).where(condition).order_by(*table.primary_key.columns)
    keys = table.c.keys()
    return read(database, lambda session: [dict(zip(keys, row, strict=True)) for row in session.execute(query)])


def _insert(session: Session, table: Table, rows: list[Row]) -> list[int]:
    """Insert rows under new ids, and return those in the same order, where the table has ids."""
    if not rows:
        return []
    if "id" not in table.c:
        session.execute(insert(table), rows)
        return []
    fresh = [{name: value for name, value in row.items() if name != "id"} for row in rows]
    return list(session.scalars(insert(table).returning(table.c.id, sort_by_parameter_order=True), fresh))
