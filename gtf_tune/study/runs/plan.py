"""Which runs score a configuration, and with which seeds."""

import hashlib
from collections.abc import Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING

from gtf_tune.definition import GtfDefinition, StudyDefinition
from gtf_tune.display import count
from gtf_tune.pipelines import OptionValue, Pipeline
from gtf_tune.pipelines.run import RunKind, RunRequest
from gtf_tune.store import runs, studies, trials
from gtf_tune.store.database import Database
from gtf_tune.store.runs import StoredRun
from gtf_tune.store.studies import Study, stored_definition

if TYPE_CHECKING:  # take OpenCV and scipy, which no reader of studies needs
    from gtf_tune.sequence import Sequence
    from gtf_tune.trajectory import Trajectory

STAGES = ("images", "features", "matches", "geometry", "calibration", "positioning", "mapping")
"""Stages of COLMAP's pipelines in running order; a stage is repeated where its options or an earlier one's change."""

MAPPING = STAGES[-1]
_STAGE_WORDS = {"features": "extraction", "matches": "matching", "geometry": "verification"}

_BITS_31 = 2**31 - 1
_BITS_63 = 2**63 - 1


@dataclass(frozen=True, eq=False)
class FinishedRun:
    """Run that has ended and is stored, with its trajectory, which is empty if the run failed.

    ``reused`` is true where the run was stored before it was asked for.
    """

    request: RunRequest
    stored: StoredRun
    trajectory: "Trajectory"
    reused: bool


@dataclass(frozen=True)
class SeedSource:
    """Seeds of one purpose of a study, all derived from the study's own: the same study gives the same runs anywhere.

    ``purpose`` separates the search from its confirmation: runs of different purposes never share noise.
    """

    study_seed: int
    purpose: str = "search"

    def run_seed(self, fingerprint: str, kind: RunKind, index: int, number: int | None = None) -> int:
        """Return the pipeline's seed for run ``index`` of a sequence; 31 bits.

        ``number`` is the trial's where trials must not share noise, else ``None``.
        """
        return _hash(self.study_seed, self.purpose, "run", fingerprint, kind, index, number) & _BITS_31

    def noise_seed(self, fingerprint: str, index: int, number: int | None = None) -> int:
        """Return the seed of the noise of noisy run ``index``; 63 bits."""
        return _hash(self.study_seed, self.purpose, "noise", fingerprint, index, number) & _BITS_63

    def sampler_seed(self, number: int) -> int:
        """Return the sampler's seed for one trial; 31 bits. An interruption before it changes nothing."""
        return _hash(self.study_seed, "sampler", number) & _BITS_31


@dataclass(frozen=True)
class RunPlanner:
    """Turn options into run requests.

    Clean run ``i`` and noisy run ``j`` of a sequence have the same seeds and the same noise in every trial (common
    random numbers: trials then differ by their options only), unless the definition asks for independent draws.
    """

    pipeline: Pipeline
    gtf: GtfDefinition
    seeds: SeedSource
    fixed_options: Mapping[str, OptionValue]

    def request(
        self,
        sequence: "Sequence",
        options: Mapping[str, OptionValue],
        run: tuple[RunKind, int],
        *,
        sigma: float,
        number: int,
    ) -> RunRequest:
        """Return the request for one run of a trial; ``sigma`` is in grey levels and ignored by clean runs."""
        kind, index = run
        noisy = kind == "noisy"
        salt = None if self.gtf.common_noise else number
        return RunRequest(
            pipeline=self.pipeline,
            options=self.effective_options(options),
            sequence=sequence,
            kind=kind,
            index=index,
            noise_sigma=sigma if noisy else 0.0,
            noise_seed=self.seeds.noise_seed(sequence.fingerprint, index, salt) if noisy else 0,
            seed=self.seeds.run_seed(sequence.fingerprint, kind, index, salt),
        )

    def effective_options(self, options: Mapping[str, OptionValue]) -> dict[str, OptionValue]:
        """Return fixed and chosen options that differ from the defaults; what equals a default changes no run."""
        table = self.pipeline.options
        checked = table.check({**self.fixed_options, **options})
        return {name: value for name, value in checked.items() if value != table.specs[name].default}


def run_order(clean_runs: int, noisy_runs: int) -> list[tuple[RunKind, int]]:
    """Return the runs of one sequence in the order in which they count: clean ones first."""
    clean: list[tuple[RunKind, int]] = [("clean", index) for index in range(clean_runs)]
    return clean + [("noisy", index) for index in range(noisy_runs)]


def _hash(*parts: object) -> int:
    text = "\x1f".join(repr(part) for part in parts)
    return int.from_bytes(hashlib.sha256(text.encode()).digest()[:8], "big")


def option_costs(stage_of: Mapping[str, str], stage_s: Mapping[str, float]) -> list[str]:
    """Return a sentence on each option that makes runs much longer because more than mapping is repeated.

    Parameters
    ----------
    stage_of
        The first stage that an option changes, by its name.
    stage_s
        The seconds of each stage in a run that began at the images; without them nothing is said of how much longer.
    """
    said = []
    for name, stage in stage_of.items():
        if stage not in _STAGE_WORDS:
            continue
        longer = ""
        if stage_s.get(MAPPING):
            repeated_s = sum(stage_s.get(later, 0.0) for later in STAGES[STAGES.index(stage) :])
            longer = f": runs take {repeated_s / stage_s[MAPPING]:.2g} x as long"
        said.append(f"'{name}' repeats {_STAGE_WORDS[stage]}{longer}")
    return said


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
        for seed in _search_seeds(definition, fingerprint, None if definition.gtf.common_noise else number)
    }
    each = definition.gtf.clean_runs + definition.gtf.noisy_runs_max
    planned = each * len(fingerprints) * len(numbers)
    stored = runs.count_unlinked(database, fingerprints, seeds)
    return KeptRuns(min(stored, planned), planned, numbers)


def _search_seeds(definition: StudyDefinition, fingerprint: str, number: int | None) -> list[int]:
    source = SeedSource(definition.search.seed)
    order = run_order(definition.gtf.clean_runs, definition.gtf.noisy_runs_max)
    return [source.run_seed(fingerprint, kind, index, number) for kind, index in order]
