"""Find the Optuna study of a study, also after another program has renamed it, and notice what others did to it.

optuna-dashboard renames a study by copying it under a new name and deleting the old one, so that all ids change. A copy
is known by the numbers that gtf-tune gave to its trials, and by their options.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any

from sqlalchemy import Select, select, update
from sqlalchemy.orm import Session

from gtf_tune.errors import OptunaStudyError
from gtf_tune.store.database import Database, models
from gtf_tune.store.database.session import read_rows, write
from gtf_tune.store.optuna.rows import NUMBER_KEY, TRIAL_ATTRIBUTES, TRIALS
from gtf_tune.store.optuna.tables import optuna_storage, with_optuna

if TYPE_CHECKING:
    from optuna.storages import RDBStorage
    from optuna.trial import FrozenTrial

    from gtf_tune.store.studies import Study


@dataclass(frozen=True)
class _Attached:
    """Trial of a study's budget that has an Optuna trial; ``optuna_number`` is the number of that."""

    number: int
    optuna_id: int | None
    optuna_number: int
    has_ended: bool
    options: Mapping[str, Any]
    value: float | None

    def is_copied_to(self, trial: "FrozenTrial") -> bool:
        """Whether an Optuna trial is a copy of that of this one; enqueued ones have no number of gtf-tune's."""
        return trial.system_attrs.get(NUMBER_KEY, self.number) == self.number and trial.params == dict(self.options)

    def can_be(self, trial: "FrozenTrial") -> bool:
        """Whether an Optuna trial without a number of gtf-tune's can be that of this one."""
        return trial.value == self.value or trial.params == dict(self.options)


def optuna_study_id(database: Database, study: "Study") -> int:
    """Return the id of the Optuna study of a study as it is now; nothing is written.

    Raises
    ------
    OptunaStudyError
        Another program deleted it, or it does not minimise one value.
    """
    storage = optuna_storage(database)
    found = _find(database, storage, study)
    check_directions(database, storage, found, study.name)
    return found


def linked(database: Database, study: "Study") -> "Study":
    """Return a study with the id of its Optuna study as it is now, after storing it where it has changed.

    A study without trials whose Optuna study was deleted gets a new one.

    Raises
    ------
    OptunaStudyError
        Another program deleted it, or it does not minimise one value.
    """
    storage = optuna_storage(database)
    if _is_own(database, storage, study):
        check_directions(database, storage, study.optuna_study_id, study.name)
        return study
    if _attached(database, study.id):
        found = optuna_study_id(database, study)
    else:
        found = create_optuna_study(database, study.name)
    ids = {trial.number: trial._trial_id for trial in storage.get_all_trials(found, deepcopy=False)}
    write(database, lambda session: _store(session, study.id, found, ids))
    return replace(study, optuna_study_id=found)


def delete_linked(database: Database, study: "Study") -> None:
    """Delete the Optuna study of a study with its trials, if it is still there under whatever name."""
    storage = optuna_storage(database)
    try:
        with_optuna(database, lambda: storage.delete_study(_find(database, storage, study)))
    except (KeyError, OptunaStudyError):
        return


def create_optuna_study(database: Database, name: str) -> int:
    """Create the Optuna study of a new study, or take over the empty one of a creation that was interrupted.

    Raises
    ------
    OptunaStudyError
        There is one of this name that has trials, belongs to another study, or does not minimise one value.
    """
    from optuna.exceptions import DuplicatedStudyError
    from optuna.study import StudyDirection

    storage = optuna_storage(database)
    try:
        return with_optuna(database, lambda: storage.create_new_study([StudyDirection.MINIMIZE], name))
    except DuplicatedStudyError:
        found = storage.get_study_id_from_name(name)
    check_directions(database, storage, found, name)
    owner = read_rows(database, select(models.Study.name).where(models.Study.optuna_study_id == found))
    if owner or storage.get_n_trials(found):
        reason = f"that belongs to study '{owner[0][0]}'" if owner else "with trials that gtf-tune did not make"
        raise OptunaStudyError(
            f"{database.shown_url} has an Optuna study '{name}' {reason}; choose another name, or another storage"
        )
    return found


def check_directions(database: Database, storage: "RDBStorage", optuna_id: int, name: str) -> None:
    """Raise `OptunaStudyError` unless an Optuna study minimises one value."""
    directions = [direction.name.lower() for direction in storage.get_study_directions(optuna_id)]
    if directions != ["minimize"]:
        raise OptunaStudyError(
            f"the Optuna study '{name}' in {database.shown_url} is to {' and '.join(directions)}, but gtf-tune's "
            "studies are to minimize one value; choose another name, or another storage"
        )


def foreign_trials(database: Database, study: "Study", trials: "Sequence[FrozenTrial]") -> int:
    """Return how many trials of its Optuna study belong to no trial of a study, and do not wait to be taken up."""
    query: Select[*tuple[Any, ...]] = select(models.Trial.optuna_number)
    ours = {row[0] for row in read_rows(database, _attached_to(study.id, query))}
    others = [trial for trial in trials if NUMBER_KEY not in trial.system_attrs and trial.number not in ours]
    return sum(trial.state.name != "WAITING" for trial in others)


def _find(database: Database, storage: "RDBStorage", study: "Study") -> int:
    return study.optuna_study_id if _is_own(database, storage, study) else _copy_of(database, storage, study)


def _is_own(database: Database, storage: "RDBStorage", study: "Study") -> bool:
    """Whether the Optuna study of the stored id is still the own one: SQLite gives ids of deleted rows away again."""
    try:
        name = storage.get_study_name_from_id(study.optuna_study_id)
    except KeyError:
        return False
    ours = _attached(database, study.id)
    if not ours:
        empty = storage.get_n_trials(study.optuna_study_id) == 0
        return name == study.name or (empty and study.optuna_study_id not in _of_others(database, study))
    numbers = _numbers(database, study)
    if any(own.optuna_id not in numbers for own in ours):
        return False
    found = {own.number: numbers[own.optuna_id] for own in ours}
    if any(number is not None for number in found.values()):
        return all(theirs in (number, None) for number, theirs in found.items())
    trials = {trial.number: trial for trial in storage.get_all_trials(study.optuna_study_id, deepcopy=False)}
    return all(own.optuna_number in trials and own.can_be(trials[own.optuna_number]) for own in ours)


def _numbers(database: Database, study: "Study") -> dict[int | None, int | None]:
    """Return the numbers that gtf-tune gave to the trials of an Optuna study, by their database ids."""
    trial, attribute = TRIALS.c, TRIAL_ATTRIBUTES.c
    numbered = (attribute.trial_id == trial.trial_id) & (attribute.key == NUMBER_KEY)
    query = select(trial.trial_id, attribute.value_json).outerjoin_from(TRIALS, TRIAL_ATTRIBUTES, numbered)
    rows = read_rows(database, query.where(trial.study_id == study.optuna_study_id))
    return {trial_id: None if text is None else int(text) for trial_id, text in rows}


def _attached_to(study_id: int, query: Select[*tuple[Any, ...]]) -> Select[*tuple[Any, ...]]:
    """Return a query of the trials of a study that have an Optuna trial."""
    trial = models.Trial
    return query.select_from(trial).where(trial.study_id == study_id, trial.optuna_number.is_not(None))


def _copy_of(database: Database, storage: "RDBStorage", study: "Study") -> int:
    """Return the id of the only Optuna study that holds the trials of a study and belongs to no other."""
    ours = _attached(database, study.id)
    taken = _of_others(database, study)
    free = {other._study_id: other.study_name for other in storage.get_all_studies() if other._study_id not in taken}
    copies = [optuna_id for optuna_id in free if ours and _holds(storage.get_all_trials(optuna_id, False), ours)]
    if len(copies) == 1:
        return copies[0]
    if copies:
        names = " and ".join(f"'{free[optuna_id]}'" for optuna_id in copies)
        raise OptunaStudyError(
            f"another program copied the Optuna study of '{study.name}' in {database.shown_url} to {names} and deleted "
            "it; delete all of these copies but one there, then run the command again"
        )
    raise OptunaStudyError(
        f"another program deleted the Optuna study of '{study.name}' in {database.shown_url}, or trials of it, so that "
        "it cannot go on; its scores and runs are kept: look at them, derive a new study on its runs, or delete it",
        remedy=("show, derive or delete", study.name),
    )


def _attached(database: Database, study_id: int) -> list[_Attached]:
    trial = models.Trial
    ids = (trial.number, trial.optuna_trial_id, trial.optuna_number)
    rows = read_rows(database, _attached_to(study_id, select(*ids, trial.state, trial.options, trial.value)))
    return [
        _Attached(number, optuna_id, optuna_number, state != "claimed", options or {}, value)
        for number, optuna_id, optuna_number, state, options, value in rows
    ]


def _of_others(database: Database, study: "Study") -> set[int]:
    query = select(models.Study.optuna_study_id).where(models.Study.id != study.id)
    return {row[0] for row in read_rows(database, query)}


def _holds(trials: "Sequence[FrozenTrial]", ours: Sequence[_Attached]) -> bool:
    """Whether Optuna's trials are copies of those of a study; unfinished ones may be missing."""
    found = {trial.number: trial for trial in trials}
    present = [own for own in ours if own.optuna_number in found]
    lost = [own for own in ours if own.has_ended and own.optuna_number not in found]
    numbered = any(NUMBER_KEY in found[own.optuna_number].system_attrs for own in present)
    return numbered and not lost and all(own.is_copied_to(found[own.optuna_number]) for own in present)


def _store(session: Session, study_id: int, optuna_id: int, ids: Mapping[int, int]) -> None:
    session.execute(update(models.Study).where(models.Study.id == study_id).values(optuna_study_id=optuna_id))
    trial = models.Trial
    for trial_id, number in session.execute(_attached_to(study_id, select(trial.id, trial.optuna_number))).all():
        session.execute(update(trial).where(trial.id == trial_id).values(optuna_trial_id=ids.get(number)))
