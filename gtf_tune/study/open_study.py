"""Open a stored study for work on this machine: its definition, pipeline, sequences and Optuna study."""

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path

import optuna

from gtf_tune.definition import DEFAULT_TRIALS, SequenceDefinition, StudyDefinition
from gtf_tune.errors import SequenceError
from gtf_tune.pipelines import Pipeline, create_pipeline
from gtf_tune.sequence import FEWEST_FRAMES, Camera, Selection, Sequence, load_sequence
from gtf_tune.store import trials
from gtf_tune.store.database import Database
from gtf_tune.store.studies import Study
from gtf_tune.study.runs.plan import RunPlanner
from gtf_tune.study.runs.seeds import SeedSource
from gtf_tune.study.search.space import SearchSpace, build_space
from gtf_tune.study.stored import stored_definition


@dataclass(frozen=True, eq=False)
class OpenStudy:
    """Hold a study that can be worked on here.

    ``sequences`` are those that the search sees, by name; ``sigmas`` their noise in grey levels. ``mismatch`` says how
    the pipeline's version here differs from the one that the study began with, where that was allowed.
    """

    database: Database
    record: Study
    definition: StudyDefinition
    pipeline: Pipeline
    space: SearchSpace
    sequences: Mapping[str, Sequence]
    sigmas: Mapping[str, float]
    optuna_study: optuna.Study = field(repr=False)
    mismatch: str = ""

    @property
    def planner(self) -> RunPlanner:
        """Return the planner of the search's runs."""
        seeds = SeedSource(self.definition.search.seed)
        return RunPlanner(self.pipeline, self.definition.gtf, seeds, self.definition.pipeline.options)

    @property
    def budget(self) -> int:
        """Return the number of trials, nominal included."""
        return trial_budget(self.definition, self.space)


def trial_budget(definition: StudyDefinition, space: SearchSpace) -> int:
    """Return the number of trials of a study: what it asks for, a grid's size, or 50."""
    if definition.search.sampler == "grid":
        size = space.grid_size()
        return min(size, definition.search.trials or size)
    return definition.search.trials or DEFAULT_TRIALS


def defined_budget(definition: StudyDefinition) -> int:
    """Return the number of trials of a study by its definition alone; makes its pipeline, which has the options."""
    return trial_budget(definition, build_space(definition, make_pipeline(definition).options))


def trials_left(database: Database, study: Study) -> int:
    """Return how many trials a stored study has to begin or to end."""
    counts = trials.counts(database, study.id)
    budget = defined_budget(stored_definition(study))
    return max(budget - sum(counts.values()), 0) + counts.get("claimed", 0)


def load_defined_sequence(definition: SequenceDefinition, root: Path, override: Path | None = None) -> Sequence:
    """Load a sequence as its definition says; relative paths start at ``root``, ``override`` replaces the path.

    Raises
    ------
    SequenceError
        The sequence cannot be read, or has too few frames for trajectories to be compared.
    """
    sequence = load_sequence(
        override or root / definition.path,
        name=definition.name,
        layout=definition.layout,
        selection=Selection(**definition.selection),
        fewest=FEWEST_FRAMES,
    )
    if definition.camera == "auto":
        return sequence
    if definition.camera == "unknown":
        return replace(sequence, camera=None)
    camera = Camera(definition.camera.model, *sequence.stored_size, params=tuple(definition.camera.params))
    return replace(sequence, camera=camera.scaled(sequence.width, sequence.height))


def check_fingerprint(sequence: Sequence, expected: str) -> None:
    """Raise `SequenceError` if the pixels of a sequence are not those that the study began with."""
    if sequence.fingerprint != expected:
        raise SequenceError(
            f"sequence '{sequence.name}' at {sequence.root} has other pixels than when the study began "
            f"(fingerprint {sequence.fingerprint[:12]}, not {expected[:12]}); restore them, give their place with "
            f"--sequence {sequence.name}=PATH, or create a new study"
        )


def make_pipeline(definition: StudyDefinition) -> Pipeline:
    """Return the pipeline that a definition names."""
    return create_pipeline(definition.pipeline.name, definition.pipeline.settings)
