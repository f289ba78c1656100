"""What a report shows, read from the database."""

from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Any

from gtf_tune.definition import StudyDefinition
from gtf_tune.display import definition_unit
from gtf_tune.store import confirmations, ground_truth_errors, runs, studies, trials
from gtf_tune.store.confirmations import Confirmation
from gtf_tune.store.database import Database
from gtf_tune.store.ground_truth_errors import Validation
from gtf_tune.store.runs import MachineFault, StoredRun, TrialRun
from gtf_tune.store.studies import Study, StudySequence, stored_definition
from gtf_tune.store.trials import Trial
from gtf_tune.study.outcome.evidence import doubts_of_detail, evidence_of
from gtf_tune.study.outcome.improvement import UNKNOWN_IMPROVEMENT, Improvement, improvement_of
from gtf_tune.study.outcome.lead import LEAD_KEY
from gtf_tune.study.outcome.recommendation import Recommendation, decide
from gtf_tune.study.outcome.verdict import Verdict, verdict_of


@dataclass(frozen=True, eq=False)
class StudyData:
    """A study as it is stored: its trials with their matrices, ground truth beside them, confirmations.

    ``sequences`` are those that the search sees, ``holdouts`` the others. ``details`` and ``validations`` are by the
    number of the trial. ``runs`` are those of trials, ``confirmation_runs`` those of confirmations; both are empty
    where nobody asked for them. ``machine_faults`` are what machines did to runs, which no trial counts.
    """

    study: Study
    definition: StudyDefinition
    sequences: tuple[StudySequence, ...]
    holdouts: tuple[StudySequence, ...]
    trials: tuple[Trial, ...]
    details: Mapping[int, Mapping[str, Any]] = field(repr=False)
    validations: Mapping[int, Sequence[Validation]] = field(repr=False)
    confirmations: tuple[Confirmation, ...] = ()
    runs: tuple[TrialRun, ...] = field(default=(), repr=False)
    confirmation_runs: tuple[StoredRun, ...] = field(default=(), repr=False)
    machine_faults: tuple[MachineFault, ...] = ()
    storage: str = ""

    @property
    def feasible(self) -> tuple[Trial, ...]:
        """Return the complete trials whose runs all register enough frames."""
        return tuple(
            trial for trial in self.trials if trial.state == "complete" and trial.feasible and trial.value is not None
        )

    @property
    def nominal(self) -> Trial | None:
        """Return trial 0 once it is complete and feasible, else None."""
        return next((trial for trial in self.feasible if trial.number == 0), None)

    @property
    def verdict(self) -> Verdict | None:
        """The verdict of the last confirmation."""
        return verdict_of(self.confirmations[-1]) if self.confirmations else None

    @cached_property
    def recommendation(self) -> Recommendation:
        """Which trial to use; needs all trials of the study."""
        doubts = doubts_of_detail(self.details.get(0, {}), self.definition.gtf)
        lead = self.study.resolved.get(LEAD_KEY, {})
        evidence = evidence_of(definition_unit(self.definition).name, self.trials, self.verdict, doubts, lead)
        best = evidence.best
        return decide(evidence, self.improvement(best.number) if best else UNKNOWN_IMPROVEMENT)

    def improvement(self, number: int) -> Improvement:
        """Return the improvement of a feasible trial of the search on nominal."""
        if not number or self.nominal is None or number not in self.details:
            return UNKNOWN_IMPROVEMENT
        return improvement_of(self.details[number], self.details[0])

    @property
    def has_several_sequences(self) -> bool:
        """Whether values are combined over sequences, relative to nominal."""
        return len(self.sequences) > 1


def read_search(database: Database, name: str) -> StudyData:
    """Return a study without its runs: what figures of the search need, cheap enough to read while it runs.

    Raises
    ------
    StorageError
        There is no such study.
    """
    study = studies.get(database, name)
    faults = tuple(runs.machine_faults(database, study.id))
    return replace(_with_trials(database, study, trials.of_study(database, study.id)), machine_faults=faults)


def read_trials(database: Database, name: str, numbers: Sequence[int]) -> StudyData:
    """Return a study with some of its trials and their runs only, at a cost that does not grow with the study.

    Raises
    ------
    StorageError
        There is no such study or trial.
    """
    study = studies.get(database, name)
    found = [trials.get(database, study.id, number) for number in dict.fromkeys(numbers)]
    used = [use for trial in found for use in runs.of_trial(database, trial.id)]
    return replace(_with_trials(database, study, found, numbers), runs=tuple(used))


def read_study(database: Database, name: str) -> StudyData:
    """Return a study with the runs of all its trials and confirmations.

    Raises
    ------
    StorageError
        There is no such study.
    """
    search = read_search(database, name)
    keys = {key: None for confirmation in search.confirmations for key in confirmation.definition.get("run_keys") or ()}
    return replace(
        search,
        runs=tuple(runs.of_study(database, search.study.id)),
        confirmation_runs=tuple(runs.find(database, keys).values()),
    )


def runs_made(runs: Sequence[TrialRun]) -> tuple[TrialRun, ...]:
    """Return each run that was executed for a trial of this study, once, in the order in which they started."""
    first = {use.run.id: use for use in reversed(runs) if not use.reused}
    return tuple(sorted(first.values(), key=lambda use: (use.run.started_at, use.run.id)))


def _with_trials(
    database: Database, study: Study, found: Sequence[Trial], numbers: Collection[int] | None = None
) -> StudyData:
    definition = stored_definition(study)
    known = studies.sequences(database, study.id)
    searched = {sequence.name for sequence in definition.searched_sequences}
    by_id = trials.details(database, [trial.id for trial in found])
    return StudyData(
        study=study,
        definition=definition,
        sequences=tuple(sequence for sequence in known if sequence.name in searched),
        holdouts=tuple(sequence for sequence in known if sequence.name not in searched),
        trials=tuple(found),
        details={trial.number: by_id.get(trial.id) or {} for trial in found},
        validations=ground_truth_errors.of_study(database, study.id, numbers),
        confirmations=tuple(confirmations.of_study(database, study.id)),
        storage=database.shown_url,
    )
