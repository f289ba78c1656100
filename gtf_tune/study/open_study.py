"""Open a stored study for work on this machine: its definition, pipeline, sequences and Optuna study."""

from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path

import optuna
from optuna.samplers import RandomSampler

from gtf_tune.definition import DEFAULT_TRIALS, SequenceDefinition, StudyDefinition
from gtf_tune.errors import DefinitionError, SequenceError
from gtf_tune.pipelines import Pipeline, create_pipeline, with_focal_prior
from gtf_tune.pipelines.run import RunRequest
from gtf_tune.sequence import FEWEST_FRAMES, LOADING_RULES, Lens, Selection, Sequence, layout_names, load_sequence
from gtf_tune.store import studies, trials
from gtf_tune.store.database import Database
from gtf_tune.store.enqueued import numbers_of
from gtf_tune.store.optuna.link import linked
from gtf_tune.store.optuna.tables import optuna_storage
from gtf_tune.store.studies import Study, StudySequence, stored_definition
from gtf_tune.study.runs.plan import RunPlanner, SeedSource
from gtf_tune.study.scoring.objective import check_rules
from gtf_tune.study.search.space import SearchSpace, build_space
from gtf_tune.study.stored_cameras import camera_change, camera_columns, with_stored_cameras

_FIRST_RULES = 1
_UNKNOWN = "unknown"


def load_defined_sequence(definition: SequenceDefinition, root: Path, pipeline: Pipeline) -> Sequence:
    """Load a sequence as its definition says, for work with a pipeline; relative paths start at ``root``.

    Raises
    ------
    SequenceError
        The sequence cannot be read, or has too few frames for trajectories to be compared.
    """
    return with_focal_prior(_load(definition, root / definition.path, LOADING_RULES), pipeline)


def load_stored_sequence(definition: SequenceDefinition, stored: StudySequence, folder: Path) -> tuple[Sequence, str]:
    """Load a sequence of a stored study, with the intrinsics that the study began with.

    Returns
    -------
    sequence, change
        The second is a sentence where the files at ``folder`` now say something else about the camera, otherwise "".

    Raises
    ------
    SequenceError
        The sequence cannot be read here, or has other pixels than when the study began.
    """
    rules = int(stored.info.get("loading_rules", _FIRST_RULES))
    definition = _in_stored_layout(definition, stored)
    fault = ""
    try:
        found = _load(definition, folder, rules)
    except SequenceError as error:
        found, fault = _load(definition.model_copy(update={"camera": _UNKNOWN}), folder, rules), str(error)
    sequence = with_stored_cameras(found, stored)
    check_fingerprint(sequence, stored.fingerprint)  # of what is handed out, which remembers the files that it saw
    return sequence, camera_change(sequence, found, fault)


def load_stored_images(definition: SequenceDefinition, stored: StudySequence, folder: Path) -> Sequence:
    """Load a sequence of a stored study to look at its images: without its camera, and whatever its pixels are now.

    Raises
    ------
    SequenceError
        The images cannot be read here.
    """
    rules = int(stored.info.get("loading_rules", _FIRST_RULES))
    definition = _in_stored_layout(definition, stored)
    return _load(definition.model_copy(update={"camera": _UNKNOWN}), folder, rules)


def sequence_row(path: str, sequence: Sequence) -> StudySequence:
    """Return what is stored of a sequence with a study, so that the study keeps it."""
    camera, info = camera_columns(sequence)
    return StudySequence(
        name=sequence.name,
        path=path,
        layout=sequence.layout,
        fingerprint=sequence.fingerprint,
        num_frames=len(sequence),
        width=sequence.width,
        height=sequence.height,
        camera=camera,
        has_ground_truth=sequence.ground_truth is not None,
        info={"loading_rules": LOADING_RULES, **info},
    )


def check_fingerprint(sequence: Sequence, expected: str) -> None:
    """Raise `SequenceError` if the pixels of a sequence are not those that the study began with."""
    if sequence.fingerprint != expected:
        raise SequenceError(
            f"sequence '{sequence.name}' at {sequence.root} has other pixels than when the study began "
            f"(fingerprint {sequence.fingerprint[:12]}, not {expected[:12]}); restore them, say where they lie, or "
            "create a new study",
            remedy=("sequence", sequence.name),
        )


def _in_stored_layout(definition: SequenceDefinition, stored: StudySequence) -> SequenceDefinition:
    """Return a definition with the layout that the study began with, where this version still knows it."""
    known = stored.layout in layout_names()
    return definition.model_copy(update={"layout": stored.layout}) if known else definition


def _load(definition: SequenceDefinition, folder: Path, rules: int) -> Sequence:
    selection = Selection(**definition.selection, rules=rules)
    return load_sequence(
        folder,
        name=definition.name,
        layout=definition.layout,
        selection=selection,
        camera=definition.camera if isinstance(definition.camera, str) else Lens(**definition.camera.model_dump()),
        fewest=FEWEST_FRAMES,
    )


@dataclass(frozen=True, eq=False)
class OpenStudy:
    """Study that can be worked on here.

    ``sequences`` are those that the search sees, by name; ``sigmas`` their noise in grey levels. ``mismatch`` says how
    the pipeline's version here differs from the one that the study began with, where that was allowed; ``changes`` are
    sentences on what the files of a sequence now say otherwise than when the study began.
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
    changes: tuple[str, ...] = ()

    @property
    def planner(self) -> RunPlanner:
        """Return the planner of the search's runs."""
        seeds = SeedSource(self.definition.search.seed)
        return RunPlanner(self.pipeline, self.definition.gtf, seeds, self.definition.fixed_options)

    def nominal_run(self, sequence: Sequence) -> RunRequest:
        """Return the first run of the nominal trial on a sequence, which shows whether a machine can run anything."""
        return self.planner.request(sequence, self.space.nominal, ("clean", 0), sigma=0.0, number=0)

    @property
    def budget(self) -> int:
        """Return the number of trials, nominal included, and those that were enqueued before the study was opened."""
        return trial_budget(self.definition, self.space) + len(numbers_of(self.record.resolved))


def open_study(
    database: Database,
    name: str,
    places: Mapping[str, Path] | None = None,
    *,
    pipeline: Pipeline | None = None,
    allow_version_mismatch: bool = False,
) -> OpenStudy:
    """Return a stored study, ready for work on this machine.

    ``places`` gives the folders of sequences that lie elsewhere here than where the study was created, ``pipeline`` the
    pipeline where its name alone does not make it, as for the function of a script.

    Raises
    ------
    GtfTuneError
        The study does not exist or is an unfinished copy, its images are missing or differ, or the pipeline has another
        version here or is not to be had.
    """
    record = studies.get(database, name)
    studies.check_whole(record)
    check_rules(record)
    definition = stored_definition(record)
    pipeline = runnable(pipeline or make_pipeline(definition), name)
    mismatch = _version_mismatch(record, pipeline.name, pipeline.version)
    if mismatch and not allow_version_mismatch:
        raise DefinitionError(
            f"study '{record.name}' {mismatch}; install that version, or accept mixed results",
            remedy=("version mismatch",),
        )
    space = build_space(definition, pipeline.options)
    record = linked(database, record)
    storage = optuna_storage(database, of_search=True)
    optuna_study = optuna.load_study(
        study_name=storage.get_study_name_from_id(record.optuna_study_id),
        storage=storage,
        sampler=RandomSampler(definition.search.seed),  # workers make one for every trial
        pruner=optuna.pruners.NopPruner(),
    )
    sequences, changes = _searched_sequences(database, record, definition, places or {})
    return OpenStudy(
        database=database,
        record=record,
        definition=definition,
        pipeline=pipeline,
        space=space,
        sequences=sequences,
        sigmas={str(key): float(value) for key, value in record.resolved["noise_sigma"].items()},
        optuna_study=optuna_study,
        mismatch=mismatch,
        changes=changes,
    )


def _searched_sequences(
    database: Database, study: Study, definition: StudyDefinition, places: Mapping[str, Path]
) -> tuple[dict[str, Sequence], tuple[str, ...]]:
    """Return the sequences that the search sees by name, and a sentence on each camera that differs now."""
    stored = {sequence.name: sequence for sequence in studies.sequences(database, study.id)}
    folders = folders_of(definition, Path(study.root), places)
    found: dict[str, Sequence] = {}
    changes = []
    for defined in definition.searched_sequences:
        name = defined.name
        found[name], change = load_stored_sequence(defined, stored[name], folders[name])
        changes.append(change)
    return found, tuple(change for change in changes if change)


def _version_mismatch(record: Study, pipeline: str, version: str) -> str:
    """Say how the pipeline and Optuna here differ from those that a study began with; corrections of Optuna do not."""
    began_with = record.resolved["versions"]
    if began_with.get(pipeline) != version:
        return f"began with {pipeline} {began_with.get(pipeline)}, but {version} is installed here"
    former = began_with.get("optuna", optuna.__version__)
    if former.split(".")[:2] != optuna.__version__.split(".")[:2]:
        return f"began with Optuna {former}, but {optuna.__version__} is installed here, which may search otherwise"
    return ""


def trial_budget(definition: StudyDefinition, space: SearchSpace) -> int:
    """Return the number of trials of a search: what its definition asks for, a grid's size, or 50."""
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
    budget = defined_budget(stored_definition(study)) + len(numbers_of(study.resolved))
    return max(budget - sum(counts.values()), 0) + counts.get("claimed", 0)


def make_pipeline(definition: StudyDefinition) -> Pipeline:
    """Return the pipeline that a definition names."""
    return create_pipeline(definition.pipeline.name, definition.pipeline.settings)


def runnable(pipeline: Pipeline, study: str) -> Pipeline:
    """Return the pipeline of a study, or raise `DefinitionError` where this process has only its description."""
    reason = getattr(pipeline, "unavailable", "")
    if reason:
        raise DefinitionError(f"study '{study}' {reason}")
    return pipeline


@dataclass(frozen=True)
class SequencePlaces:
    """Where sequences lie here: named ones in ``named``, others below ``data_root`` or where the study began.

    Whatever is found is compared with the study's fingerprint before anything runs on it.
    """

    named: Mapping[str, Path] = field(default_factory=dict)
    data_root: Path | None = None

    def of(self, sequences: list[StudySequence]) -> dict[str, Path]:
        """Return the places of those sequences that do not lie where their study says.

        Raises
        ------
        SequenceError
            A data root is given and a sequence is neither below it nor named.
        """
        found = {sequence.name: self.named[sequence.name] for sequence in sequences if sequence.name in self.named}
        if self.data_root is None:
            return found
        return found | {
            sequence.name: _below(self.data_root, sequence) for sequence in sequences if sequence.name not in found
        }


def folders_of(definition: StudyDefinition, root: Path, named: Mapping[str, Path]) -> dict[str, Path]:
    """Return where the searched sequences lie: where ``named`` says, otherwise where the study says.

    Raises
    ------
    SequenceError
        ``named`` has a name that no sequence has, or a sequence does not lie where the study says.
    """
    names = [sequence.name for sequence in definition.sequences]
    for name in named:
        if name not in names:
            raise SequenceError(
                f"study '{definition.name}' has no sequence '{name}', only {', '.join(names)}; name one of these",
                remedy=("sequence", names[0]),
            )
    return {sequence.name: folder_of(sequence, root, named) for sequence in definition.searched_sequences}


def folder_of(sequence: SequenceDefinition, root: Path, named: Mapping[str, Path]) -> Path:
    """Return where one sequence of a study lies: where ``named`` says, otherwise where the study says.

    Raises
    ------
    SequenceError
        It does not lie where the study says.
    """
    if sequence.name in named:
        return named[sequence.name]
    folder = root / sequence.path
    if not folder.exists():
        raise SequenceError(
            f"sequence '{sequence.name}' is not at {folder} on this machine; say where it lies",
            remedy=("sequence", sequence.name),
        )
    return folder


def _below(root: Path, sequence: StudySequence) -> Path:
    for place in (root / sequence.name, root / Path(sequence.path).name):
        if place.exists():
            return place
    raise SequenceError(
        f"sequence '{sequence.name}' is not in {root}; put it there under its name, or say where it lies",
        remedy=("sequence", sequence.name),
    )
