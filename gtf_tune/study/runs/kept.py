"""Count what an interrupted trial has already: runs are stored as they end, and linked to their trial at its end."""

from dataclasses import dataclass

from gtf_tune.definition import StudyDefinition
from gtf_tune.display import count
from gtf_tune.store import runs, studies, trials
from gtf_tune.store.database import Database
from gtf_tune.store.studies import Study, stored_definition
from gtf_tune.study.runs.plan import SeedSource, run_order


@dataclass(frozen=True)
class KeptRuns:
    """Runs of trials that began and have not ended: how many are stored, of how many, for which trials."""

    stored: int
    planned: int
    numbers: tuple[int, ...]

    @property
    def text(self) -> str:
        """The same in words; empty where no trial is under way."""
        if not self.numbers:
            return ""
        listed = ", ".join(map(str, self.numbers))
        return f"{self.stored} of {count(self.planned, 'run')} of trial {listed} are stored"


def kept_runs(database: Database, study: Study) -> KeptRuns:
    """Return what is stored of the trials of a study that are under way or were interrupted."""
    known = trials.of_study(database, study.id)
    numbers = tuple(trial.number for trial in known if trial.state == "claimed" and trial.attempts)
    if not numbers:
        return KeptRuns(0, 0, ())
    definition = stored_definition(study)
    searched = {sequence.name for sequence in definition.searched_sequences}
    fingerprints = [row.fingerprint for row in studies.sequences(database, study.id) if row.name in searched]
    seeds = {
        seed
        for number in numbers
        for fingerprint in fingerprints
        for seed in _seeds(definition, fingerprint, None if definition.gtf.common_noise else number)
    }
    each = definition.gtf.clean_runs + definition.gtf.noisy_runs_max
    planned = each * len(fingerprints) * len(numbers)
    stored = runs.count_unlinked(database, fingerprints, seeds)
    return KeptRuns(min(stored, planned), planned, numbers)


def _seeds(definition: StudyDefinition, fingerprint: str, number: int | None) -> list[int]:
    source = SeedSource(definition.search.seed)
    order = run_order(definition.gtf.clean_runs, definition.gtf.noisy_runs_max)
    return [source.run_seed(fingerprint, kind, index, number) for kind, index in order]
