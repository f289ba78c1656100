"""Create a study in a database."""

import contextlib
import warnings
from collections.abc import Callable, Iterable, Mapping
from pathlib import Path
from types import MappingProxyType
from typing import Any

import optuna
from optuna.exceptions import ExperimentalWarning
from pydantic import TypeAdapter, ValidationError

from gtf_tune.definition import (
    Axis,
    RangeAxis,
    StudyDefinition,
    bound_faults,
    definition_from_dict,
    dump_definition,
    refuse_unbounded,
)
from gtf_tune.errors import DefinitionError, GtfTuneError, OptunaStudyError, SequenceError, first_remedy, numbered
from gtf_tune.pipelines import OptionTable, OptionValue, Pipeline, create_pipeline
from gtf_tune.pipelines.command.places import rooted
from gtf_tune.pipelines.preset_spaces import preset_pipelines, preset_space
from gtf_tune.sequence import Sequence, say_notes
from gtf_tune.store import enqueued, studies
from gtf_tune.store.database import Database
from gtf_tune.store.optuna.link import create_optuna_study
from gtf_tune.store.optuna.tables import optuna_storage
from gtf_tune.store.studies import NewStudy, Study
from gtf_tune.study.open_study import load_defined_sequence, make_pipeline, runnable, sequence_row
from gtf_tune.study.outcome.lead import LEAD_KEY
from gtf_tune.study.scoring.objective import RESOLVED_KEY, SCORING_VERSION
from gtf_tune.study.search.samplers import check_search
from gtf_tune.study.search.space import SearchSpace, build_space, grid_values, option_faults, space_faults
from gtf_tune.version import __version__

METRIC_NAME = "GTF ATE"


def checked_definition(
    data: Mapping[str, Any], source: str, hints: Mapping[str, str] = MappingProxyType({}), root: Path | None = None
) -> StudyDefinition:
    """Return a definition whose options and axes suit its pipeline.

    A range in logarithms cannot hold 0: where that is nominal, the range becomes the list of 0 and of its points.

    ``hints`` say, by the name of a section, how to give it where it is missing. ``root`` is the folder that relative
    paths in the settings of a command start from, wherever the study is worked on later.

    Raises
    ------
    DefinitionError
        Something is wrong; the message names every fault, of the structure of the file and of the options in it.
    """
    refuse_unbounded(data, source)
    if root is not None:
        data = _rooted(data, root)
    table = _option_table(data)
    if isinstance(table, OptionTable):
        data = _with_zeros(data, table)
    faults = _option_faults(data, table)
    try:
        definition = definition_from_dict(data, source, map(str, faults), hints)
    except DefinitionError as error:
        error.remedy = first_remedy(faults)
        raise
    if excesses := bound_faults(definition):
        raise DefinitionError(f"{source}: {numbered(excesses)}")
    return definition


def _rooted(data: Mapping[str, Any], root: Path) -> Mapping[str, Any]:
    section = _mapping(data.get("pipeline"))
    settings = section.get("settings", {})
    if section.get("name") != "command" or not isinstance(settings, Mapping):
        return data
    return {**data, "pipeline": {**section, "settings": dict(rooted(settings, root))}}


def create_study(
    database: Database,
    definition: StudyDefinition,
    root: Path,
    pipeline: Pipeline | None = None,
    *,
    resolved: Mapping[str, Any] = MappingProxyType({}),
    on_note: Callable[[str], None] | None = None,
) -> Study:
    """Check a definition against its sequences, store it, and return the stored study.

    ``root`` is the folder that the paths of the sequences are relative to, ``pipeline`` the pipeline where its name
    alone does not make it, as for the function of a script. ``resolved`` is kept with the study as it is. ``on_note``
    is called with each irregularity of the sequences, once the study is stored.

    Raises
    ------
    GtfTuneError
        A sequence cannot be read, two of them have the same images, an option is refused, a package is missing, or the
        name is taken.
    """
    _refuse_early_stopping(definition)
    pipeline = runnable(pipeline or make_pipeline(definition), definition.name)
    definition = _with_device(definition, pipeline)
    space = build_space(definition, pipeline.options)
    pipeline.options.check({**definition.fixed_options, **space.nominal})
    check_search(definition, space)
    _check_first(definition, space, pipeline.options)
    refuse_taken_name(database, definition.name)
    loaded = [load_defined_sequence(defined, root, pipeline) for defined in definition.sequences]
    _refuse_same_images(loaded)
    pairs = zip(definition.sequences, loaded, strict=True)
    rows = tuple(sequence_row(defined.path, sequence) for defined, sequence in pairs)
    known = {
        **resolved,
        **_lead(definition),
        "noise_sigma": _sigmas(definition),
        RESOLVED_KEY: SCORING_VERSION,
        "versions": {"gtf_tune": __version__, pipeline.name: pipeline.version, "optuna": optuna.__version__},
    }
    new = NewStudy(
        definition.name,
        _optuna_study(database, definition.name),
        dump_definition(definition),
        known,
        str(root),
        rows,
    )
    study = studies.add(database, new)
    for options in definition.search.first:
        searched = {axis.name: options.get(axis.name, axis.nominal) for axis in space.axes}
        enqueued.append(database, study.id, searched)
    if on_note is not None:
        for sequence in loaded:
            say_notes(sequence, on_note, named=len(loaded) > 1)
    return study


def _lead(definition: StudyDefinition) -> dict[str, Any]:
    """Return which of the first trials leads, for the resolved part: the one that the preset of the pipeline names."""
    name, first = definition.pipeline.name, definition.search.first
    lead = preset_space(name).lead if name in preset_pipelines() else None
    if lead is None or dict(lead.options) not in first:
        return {}
    return {LEAD_KEY: {"number": first.index(dict(lead.options)) + 1, "margin": lead.margin}}


def _refuse_early_stopping(definition: StudyDefinition) -> None:
    """Raise `DefinitionError` for what earlier versions stopped trials by; stored studies may name it."""
    gtf = definition.gtf
    if gtf.noisy_runs_min < gtf.noisy_runs_max:
        raise DefinitionError(
            f"a number of noisy runs that grows, here {gtf.noisy_runs_text}, is no longer part of gtf-tune: it cost "
            f"more runs than it saved; give one number, such as noisy_runs = {gtf.noisy_runs_min}"
        )
    if definition.search.pruner != "none":
        raise DefinitionError(
            f"pruner '{definition.search.pruner}' is no longer part of gtf-tune: it cost more runs than it saved; "
            "leave it out"
        )


def _with_device(definition: StudyDefinition, pipeline: Pipeline) -> StudyDefinition:
    """Return the definition with the device that ``auto`` is here: all machines of a study compute on one kind."""
    settings = definition.pipeline.settings
    if settings.get("device") != "auto":
        return definition
    device = dict(pipeline.settings).get("device", "cpu")
    section = definition.pipeline.model_copy(update={"settings": {**settings, "device": device}})
    return definition.model_copy(update={"pipeline": section})


def _check_first(definition: StudyDefinition, space: SearchSpace, table: OptionTable) -> None:
    """Raise `DefinitionError` unless the space holds what is to be tried first."""
    faults = [
        fault for options in definition.search.first for fault in option_faults(space, definition, table, options)
    ]
    if faults:
        raise DefinitionError(f"study '{definition.name}' cannot try first what search.first has: {numbered(faults)}")


def refuse_taken_name(database: Database, name: str) -> None:
    """Raise `StorageError` if the database has a study of this name."""
    if name in studies.names(database):
        raise studies.name_is_taken(database, name)


def _refuse_same_images(sequences: Iterable[Sequence]) -> None:
    """Raise `SequenceError` for two sequences of the same pixels: they are not independent, and neither is held out."""
    names: dict[str, str] = {}
    for sequence in sequences:
        other = names.setdefault(sequence.fingerprint, sequence.name)
        if other != sequence.name:
            raise SequenceError(
                f"sequences '{other}' and '{sequence.name}' have the same images, which would count as if they were "
                "independent; leave one of them out, or give it other frames"
            )


def _optuna_study(database: Database, name: str) -> int:
    """Create the Optuna study of a new study, and name what its values are."""
    try:
        created = create_optuna_study(database, name)
    except OptunaStudyError:
        refuse_taken_name(database, name)  # another process may just have created it
        raise
    study = optuna.load_study(study_name=name, storage=optuna_storage(database))
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", ExperimentalWarning)
        study.set_metric_names([METRIC_NAME])
    return created


def _option_table(data: Mapping[str, Any]) -> OptionTable | GtfTuneError | None:
    """Return the options of a definition's pipeline, why it cannot be made, or None where none is named."""
    section = _mapping(data.get("pipeline"))
    if not isinstance(section.get("name"), str):
        return None
    try:
        return create_pipeline(section["name"], _mapping(section.get("settings"))).options
    except GtfTuneError as error:
        return error


def _option_faults(data: Mapping[str, Any], table: OptionTable | GtfTuneError | None) -> list[GtfTuneError]:
    if not isinstance(table, OptionTable):
        return [] if table is None else [table]
    section = _mapping(data.get("pipeline"))
    faults: list[GtfTuneError] = []
    nominal = _checked(section.get("nominal"), table, faults)
    _checked(section.get("options"), table, faults)
    search = _mapping(data.get("search"))
    first = search.get("first")
    for options in [*(first if isinstance(first, list) else ()), *_mapping(search.get("baselines")).values()]:
        _checked(options, table, faults)
    return faults + space_faults(_sound_axes(data.get("space")), table, nominal)


def _with_zeros(data: Mapping[str, Any], table: OptionTable) -> Mapping[str, Any]:
    space, nominal = data.get("space"), _mapping(_mapping(data.get("pipeline")).get("nominal"))
    lists = {
        name: {"values": [0, *grid_values(table.specs[name], axis)]}
        for name, axis in _sound_axes(space).items()
        if isinstance(axis, RangeAxis) and axis.log and name in table.specs
        if nominal.get(name, table.specs[name].default) == 0
    }
    return {**data, "space": {**_mapping(space), **lists}} if lists else data


def _checked(options: object, table: OptionTable, faults: list[GtfTuneError]) -> dict[str, OptionValue]:
    """Return the options that the pipeline takes, and append an error to ``faults`` for every other one."""
    checked: dict[str, OptionValue] = {}
    for name, value in _mapping(options).items():
        if isinstance(value, Mapping | list):  # a fault of the shape, which is reported already
            continue
        try:
            checked |= table.check({name: value})
        except GtfTuneError as error:
            faults.append(error)
    return checked


def _sound_axes(space: object) -> dict[str, Axis]:
    """Return the axes that have the right shape; the others are reported as faults of the definition."""
    adapter: TypeAdapter[Axis] = TypeAdapter(Axis)
    axes: dict[str, Axis] = {}
    for name, axis in _mapping(space).items():
        with contextlib.suppress(ValidationError):
            axes[name] = adapter.validate_python(axis)
    return axes


def _mapping(value: object) -> Mapping[str, Any]:
    return value if isinstance(value, Mapping) else {}


def _sigmas(definition: StudyDefinition) -> dict[str, float]:
    """Return the noise of each sequence as far as it is known: "auto" is measured before the first trial."""
    sigma = definition.gtf.noise_sigma
    return {} if isinstance(sigma, str) else {sequence.name: sigma for sequence in definition.sequences}
