"""Check a database: its tables, what refers to what, and every stored trajectory."""

from collections.abc import Iterator
from contextlib import suppress
from dataclasses import dataclass

from sqlalchemy import Select, func, select, text

from gtf_tune.errors import OptunaStudyError, StorageError
from gtf_tune.store import studies, trials
from gtf_tune.store.database import Database, models
from gtf_tune.store.database.schema import current_revision
from gtf_tune.store.database.session import chunks, read_rows
from gtf_tune.store.maintenance.check_contents import check_tables, unreadable
from gtf_tune.store.optuna.link import foreign_trials, optuna_study_id
from gtf_tune.store.optuna.tables import optuna_storage
from gtf_tune.store.runs import trajectories
from gtf_tune.store.studies import NOISE_RUNS_KEY, Study
from gtf_tune.store.trials import MADE_BY_KEY


@dataclass(frozen=True)
class CheckReport:
    """What a check found.

    ``problems`` need someone; ``notes`` are harmless leftovers, such as runs that no trial uses.
    """

    revision: str
    optuna_revision: str
    studies: int
    trials: int
    runs: int
    problems: tuple[str, ...]
    notes: tuple[str, ...]

    @property
    def ok(self) -> bool:
        """Whether nothing is wrong."""
        return not self.problems


def check(database: Database) -> CheckReport:
    """Return what is wrong with a database, after reading all of it.

    Raises
    ------
    StorageError
        It cannot be read at all, or lacks tables.
    """
    check_tables(database)
    garbled = unreadable(database)
    problems = [*_damage(database), *_orphans(database), *_missing_outputs(database), *garbled]
    problems += [
        *_optuna_studies(database),
        *_missing_trials(database),
        *_mixed(database),
        *_bad_trajectories(database),
    ]
    return CheckReport(
        revision=current_revision(database.reader),
        optuna_revision=optuna_storage(database).get_current_version(),
        studies=_count(database, select(func.count(models.Study.id))),
        trials=_count(database, select(func.count(models.Trial.id))),
        runs=_count(database, select(func.count(models.Run.id))),
        problems=tuple(problems),
        notes=() if garbled else tuple(_notes(database)),
    )


def _damage(database: Database) -> Iterator[str]:
    if database.engine.dialect.name == "sqlite":
        found = [row[0] for row in read_rows(database, text("PRAGMA integrity_check"))]
        if found != ["ok"]:
            yield f"SQLite finds the file damaged ({found[0]}, {len(found)} faults in all); restore a backup"


def _orphans(database: Database) -> Iterator[str]:
    """Yield rows whose owner is missing: only a tool that switches foreign keys off can make them."""
    for table in models.Base.metadata.sorted_tables:
        for key in table.foreign_keys:
            parent = key.column.table.alias()
            lonely = ~select(parent.c.id).where(parent.c[key.column.name] == key.parent).exists()
            count = _count(database, select(func.count()).select_from(table).where(lonely))
            if count:
                yield f"{count} rows of {table.name} refer to missing rows of {key.column.table.name}; restore a backup"


def _missing_outputs(database: Database) -> Iterator[str]:
    query = select(models.Run.key).outerjoin(models.RunOutput).where(models.RunOutput.run_id.is_(None))
    for (key,) in read_rows(database, query):
        yield f"run {key} has lost its trajectory; restore a backup"


def _optuna_studies(database: Database) -> Iterator[str]:
    """Yield Optuna studies that are gone or of another kind, and what they say otherwise about a trial."""
    storage = optuna_storage(database)
    ours = models.Trial
    for study_id, name in read_rows(database, select(models.Study.id, models.Study.name).order_by(models.Study.id)):
        try:
            optuna_id = optuna_study_id(database, studies.get(database, name))
        except OptunaStudyError as error:
            yield str(error)
            continue
        except StorageError:  # a damaged text, which is named already
            continue
        told = {trial.number: trial for trial in storage.get_all_trials(optuna_id, deepcopy=False)}
        scored = select(ours.number, ours.optuna_number, ours.value).where(ours.study_id == study_id)
        ended = ours.state.in_(("complete", "pruned"))
        for number, optuna_number, value in read_rows(database, scored.where(ended).order_by(ours.number)):
            trial = told.get(optuna_number)
            if trial is None:
                yield f"trial {number} of study '{name}' has no Optuna trial; restore a backup"
            elif trial.state.is_finished() and trial.values != [value]:
                yield f"trial {number} of study '{name}' has another score in Optuna's tables; restore a backup"


def _missing_trials(database: Database) -> Iterator[str]:
    """Yield gaps among the trials of a study, and scores without the runs that they come from."""
    trial = models.Trial
    spans = (
        select(models.Study.name, func.count(trial.id), func.max(trial.number)).join(trial).group_by(models.Study.id)
    )
    for name, count, last in read_rows(database, spans):
        if count != last + 1:
            yield f"study '{name}' lacks {last + 1 - count} of its trials 0 to {last}; restore a backup"
    scored = select(models.Study.name, trial.number).join(trial).where(trial.state.in_(("complete", "pruned")))
    lonely = ~select(models.TrialRun.run_id).where(models.TrialRun.trial_id == trial.id).exists()
    for name, number in read_rows(database, scored.where(lonely).order_by(models.Study.id, trial.number)):
        yield f"trial {number} of study '{name}' has a score but no runs; restore a backup"


def _mixed(database: Database) -> Iterator[str]:
    """Yield a sentence for every study of which workers of different kinds scored trials."""
    trial = models.Trial
    ended = trial.state.in_(("complete", "pruned"))
    query = select(models.Study.name, trial.number, trial.detail).join(trial).where(ended)
    kinds: dict[str, dict[tuple[object, object], list[int]]] = {}
    for name, number, detail in read_rows(database, query.order_by(models.Study.id, trial.number)):
        found = (detail or {}).get(MADE_BY_KEY)
        if found:  # earlier versions noted nothing
            kinds.setdefault(name, {}).setdefault((found.get("scoring"), found.get("definition")), []).append(number)
    for name, by_kind in kinds.items():
        first, *others = by_kind.values()
        for numbers in others:
            yield (
                f"study '{name}' mixes trials that were scored by different rules or definitions ({numbers[0]} and "
                f"{len(numbers) - 1} more otherwise than {first[0]}); compare them in a new study only"
            )


def _bad_trajectories(database: Database) -> Iterator[str]:
    keys = [key for (key,) in read_rows(database, select(models.Run.key).join(models.RunOutput))]
    for some in chunks(keys):
        try:
            trajectories(database, some)
        except StorageError:
            yield from _one_by_one(database, some)


def _one_by_one(database: Database, keys: list[str]) -> Iterator[str]:
    for key in keys:
        try:
            trajectories(database, [key])
        except StorageError as error:
            yield str(error)


def _notes(database: Database) -> Iterator[str]:
    unused = len(_unused_runs(database))
    if unused:
        yield (
            f"{unused} runs belong to no trial and no confirmation, such as those of trials that were stopped; they "
            "will be reused"
        )
    for study in [studies.get(database, name) for name in studies.names(database)]:
        if study.state == "copying":
            yield f"study '{study.name}' is an unfinished copy; delete it and copy it again"
        versions = trials.version_mismatches(database, study.id)
        if versions:
            found = sorted(set(versions.values()))
            yield f"study '{study.name}' has {len(versions)} trials of other versions: it {'; '.join(found)}"
        if trials.untold(database, study.id):
            yield f"Optuna does not know yet that some trials of '{study.name}' have ended; the next worker reports it"
        with suppress(OptunaStudyError):
            yield from _of_other_programs(database, study)


def _of_other_programs(database: Database, study: Study) -> Iterator[str]:
    storage, optuna_id = optuna_storage(database), optuna_study_id(database, study)
    name = storage.get_study_name_from_id(optuna_id)
    if name != study.name:
        yield f"another program renamed the Optuna study of '{study.name}' to '{name}'; gtf-tune goes on with it"
    foreign = foreign_trials(database, study, storage.get_all_trials(optuna_id, deepcopy=False))
    if foreign:
        yield f"other programs added {foreign} trials to the Optuna study of '{study.name}'; its search ignores them"


def _unused_runs(database: Database) -> set[str]:
    """Return the keys of the runs that no trial, no confirmation and no choice of a noise uses."""
    used = select(models.TrialRun.run_id).where(models.TrialRun.run_id == models.Run.id)
    of_no_trial = {key for (key,) in read_rows(database, select(models.Run.key).where(~used.exists()))}
    if not of_no_trial:
        return of_no_trial
    plans = [plan for (plan,) in read_rows(database, select(models.Confirmation.definition))]
    resolved = [found for (found,) in read_rows(database, select(models.Study.resolved))]
    confirmed = {key for plan in plans for key in plan.get("run_keys") or ()}
    return of_no_trial - confirmed - {key for found in resolved for key in found.get(NOISE_RUNS_KEY) or ()}


def _count(database: Database, query: Select[int]) -> int:
    return int(read_rows(database, query)[0][0])
