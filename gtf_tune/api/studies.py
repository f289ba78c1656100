"""Create, open and tune studies from Python, and score single configurations."""

import os
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from pydantic import TypeAdapter

from gtf_tune.api.defaults import storage_or_default
from gtf_tune.api.executor import executor_here
from gtf_tune.api.study import Access, Study, quiet_optuna
from gtf_tune.definition import Axis, GtfDefinition
from gtf_tune.definition.loading import section_from_dict
from gtf_tune.definition.model import name_from
from gtf_tune.errors import DefinitionError
from gtf_tune.pipelines import OptionValue, Pipeline, create_pipeline
from gtf_tune.pipelines.function import SlamFunction, from_function
from gtf_tune.pipelines.function.imported import create_imported, is_importable, needs_nominal, resolved
from gtf_tune.pipelines.function.pipeline import checked_nominal, name_of
from gtf_tune.pipelines.preset_spaces import preset_search, preset_space
from gtf_tune.sequence import FEWEST_FRAMES, load_sequence
from gtf_tune.store import studies
from gtf_tune.store.database import create_database, open_database
from gtf_tune.store.studies import stored_definition
from gtf_tune.study import create as creation
from gtf_tune.study.evaluate import Configuration, Evaluation, evaluate_configuration

PathLike = str | os.PathLike[str]
Sequences = PathLike | Sequence[PathLike] | Mapping[str, PathLike]
Axes = Mapping[str, tuple[Any, ...] | Sequence[OptionValue] | Mapping[str, Any]]
"""By option: (low, high), (low, high, "log"), a list of values, or the table of a study definition."""

_AXIS: TypeAdapter[Axis] = TypeAdapter(Axis)


def create_study(
    name: str,
    *,
    sequence: Sequences,
    space: Axes | None = None,
    pipeline: str | SlamFunction = "glomap",
    trials: int | None = None,
    nominal: Mapping[str, object] | None = None,
    version: str = "",
    options: Mapping[str, OptionValue] | None = None,
    settings: Mapping[str, object] | None = None,
    gtf: Mapping[str, Any] | None = None,
    search: Mapping[str, Any] | None = None,
    limits: Mapping[str, Any] | None = None,
    storage: PathLike | None = None,
) -> Study:
    """Create a study in a storage and return it; nothing runs yet.

    A function as a pipeline is called as ``f(images, options, seed)`` in child processes, so that a crash, a hang or a
    leak of one run is a failed run and no more:

    - ``images`` (`gtf_tune.pipelines.function.RunImages`) has the ``folder`` of the images, their ``names``,
      ``arrays`` (uint8, read when indexed), ``timestamps``, ``frame_ids``, the ``camera`` and a ``workspace`` folder;
    - ``options`` has a value for every name in ``nominal``; ``seed`` is a non-negative integer, the only source of
      randomness that makes runs repeatable;
    - it returns a `Trajectory` with the frame ids of the images; or positions (n, 3) and quaternions x, y, z, w (n, 4),
      both world-from-camera, a row for each image and NaN where it has no pose; or the path of a trajectory file that
      names its images or has their timestamps.

    A function of a script or notebook travels by value (cloudpickle), with the globals that it uses; one of an
    importable module is imported by its name. Runs are reused as long as the function's version stays the same:
    ``version``, else the SHA-256 of its source, or of the file of its module. Functions that it calls are not covered:
    give another ``version`` when they change.

    Parameters
    ----------
    name
        Name of the study, unique in its storage.
    sequence
        Folder of images or data set in any known layout; or several of them, in a list or by name.
    space
        What to search, by option: ``(low, high)``, ``(low, high, "log")``, or a list of values. By default what
        ``gtf-tune pipeline presets`` shows for the pipeline.
    pipeline
        Name of a pipeline (``glomap``, ``colmap``, ...), ``module:attribute``, or a Python function.
    trials
        Total number of trials, nominal included; by default the size of a grid, else 50.
    nominal
        What nominal means: trial 0, and what every improvement is measured against. For a function it is required and
        names all its options with their defaults; for a program the options that differ from its defaults.
    version
        For a function: what to put in the keys of runs instead of the digest of its source.
    options
        Options to hold fixed.
    settings
        Settings of the pipeline that are no options, such as ``{"pairing": "sequential"}``.
    gtf, search, limits
        The sections of a study definition, such as ``gtf={"noisy_runs": 8}``; see docs/definition-reference.md.
    storage
        File or database URL; by default that of GTF_TUNE_STORAGE, else ``gtf-tune.db`` in the current folder.

    Raises
    ------
    DefinitionError
        Something given is wrong; the message names every fault.
    SequenceError
        The images cannot be read.
    StorageError
        The name is taken, or the storage cannot be written.
    """
    plan = _plan(name, sequence, space, pipeline, nominal, version)
    for section, given in (("gtf", gtf), ("search", search), ("limits", limits)):
        plan.data[section] = {**plan.data.get(section, {}), **(given or {})}
    plan.data["pipeline"]["options"] = dict(options or {})
    plan.data["pipeline"]["settings"].update(settings or {})
    if trials is not None:
        plan.data["search"]["trials"] = trials
    with quiet_optuna():
        definition = creation.checked_definition(plan.data, f"study '{name}'", root=Path.cwd())
        database = create_database(storage_or_default(storage))
        creation.create_study(database, definition, Path.cwd(), plan.pipeline)
    return Study(database, name, Access(plan.pipeline))


def open_study(
    name: str,
    *,
    pipeline: SlamFunction | None = None,
    storage: PathLike | None = None,
    allow_version_mismatch: bool = False,
) -> Study:
    """Return a study of a storage.

    Parameters
    ----------
    pipeline
        The function that the study tunes where it is one of a script or notebook: nobody else has it. Without it the
        study can be looked at, but not run.
    storage
        File or database URL; by default that of GTF_TUNE_STORAGE, else ``gtf-tune.db`` in the current folder.
    allow_version_mismatch
        Whether to go on with another version of the pipeline than the study began with; its trials are marked.

    Raises
    ------
    StorageError
        There is no such storage or study.
    DefinitionError
        The study tunes another pipeline, or the function has changed since it began.
    """
    database = open_database(storage_or_default(storage))
    record = studies.get(database, name)
    made = None
    if pipeline is not None:
        stored = stored_definition(record).pipeline
        if stored.name != name_of(pipeline):
            raise DefinitionError(
                f"study '{name}' tunes the pipeline '{stored.name}', not '{name_of(pipeline)}'; give that function"
            )
        made = _function_pipeline(pipeline, stored.settings.get("nominal"), str(stored.settings.get("version", "")))
        began_with = record.resolved["versions"].get(made.name)
        if began_with != made.version and not allow_version_mismatch:
            raise DefinitionError(
                f"the function '{stored.name}' has changed since study '{name}' began; restore it, create a new study, "
                "or accept mixed results with allow_version_mismatch=True"
            )
    return Study(database, name, Access(made, allow_version_mismatch))


def tune(
    sequence: Sequences,
    *,
    space: Axes | None = None,
    name: str = "",
    pipeline: str | SlamFunction = "glomap",
    trials: int | None = None,
    storage: PathLike | None = None,
    jobs: int | None = None,
    **more: Any,
) -> Study:
    """Create a study or go on with it, run its trials, confirm the best ones, and return the study.

    Calling it again goes on where it stopped; what the study was created with stays as it is, but for ``trials``.

    Parameters
    ----------
    sequence, space, pipeline, storage, more
        As `create_study` takes them.
    name
        Name of the study; by default that of the sequence's folder.
    trials
        Total number of trials, nominal included.
    jobs
        How many runs go side by side; by default one for each core.

    Raises
    ------
    GtfTuneError
        As `create_study`, `Study.run` and `Study.confirm` do.
    """
    named = name or _sequences(sequence)[0]["name"]
    database = create_database(storage_or_default(storage))
    is_known = named in studies.names(database)
    database.close()
    given = {"sequence": sequence, "space": space, "pipeline": pipeline, **more}
    if is_known:
        study = open_study(named, pipeline=None if isinstance(pipeline, str) else pipeline, storage=storage)
        _refuse_other(study, _plan(named, sequence, space, pipeline, more.get("nominal"), more.get("version", "")))
    else:
        study = create_study(named, trials=trials, storage=storage, **given)
    return study.tune(trials, jobs=jobs)


def evaluate(
    sequence: PathLike,
    *,
    pipeline: str | SlamFunction = "glomap",
    options: Mapping[str, object] | None = None,
    nominal: Mapping[str, object] | None = None,
    settings: Mapping[str, object] | None = None,
    gtf: Mapping[str, Any] | None = None,
    seed: int = 0,
    jobs: int | None = None,
) -> Evaluation:
    """Return the GTF ATE of one configuration on one sequence; nothing is stored.

    Parameters
    ----------
    sequence
        Folder of images or data set in any known layout.
    pipeline, nominal, settings
        As `create_study` takes them.
    options
        Values of options; all others have their defaults.
    gtf
        The section of a study definition, such as ``{"noisy_runs": 8, "noise_sigma": 2.0}``.
    seed
        Seed of noise and runs.
    jobs
        How many runs go side by side; by default one for each core.

    Raises
    ------
    GtfTuneError
        The images cannot be read, or the pipeline, an option or a word is unknown.
    """
    if isinstance(pipeline, str):
        chosen = create_pipeline(pipeline, settings or {})
    else:
        chosen = _function_pipeline(pipeline, nominal, "")
    definition = section_from_dict(GtfDefinition, gtf or {}, "gtf")
    wanted = Configuration(chosen, chosen.options.check(options or {}), definition, seed)
    loaded = load_sequence(sequence, fewest=FEWEST_FRAMES)
    with executor_here(jobs) as executor:
        return evaluate_configuration(wanted, loaded, executor)


@dataclass
class _Plan:
    """Data of a study definition that is being put together, and the pipeline where its name does not make it."""

    data: dict[str, Any]
    pipeline: Pipeline | None


def _plan(
    name: str,
    sequence: Sequences,
    space: Axes | None,
    pipeline: str | SlamFunction,
    nominal: Mapping[str, object] | None,
    version: str,
) -> _Plan:
    searched = (
        preset_space(pipeline if isinstance(pipeline, str) else name_of(pipeline)).axes() if space is None else space
    )
    axes = {option: _axis(option, axis) for option, axis in searched.items()}
    data: dict[str, Any] = {"name": name, "sequences": _sequences(sequence), "space": axes, "search": {}}
    if space is None and isinstance(pipeline, str):
        data["search"] = preset_search(pipeline, axes, {"nominal": nominal or {}})
    if isinstance(pipeline, str):
        own = {"nominal": dict(nominal or {})}
        is_function = ":" in pipeline and needs_nominal(pipeline)
        section = {"name": pipeline, "settings": own} if is_function else {"name": pipeline, "settings": {}, **own}
        return _Plan({**data, "pipeline": section}, None)
    defaults = checked_nominal(name_of(pipeline), _floated(nominal or getattr(pipeline, "nominal", None), axes))
    made = _function_pipeline(pipeline, defaults, version)
    settings = {"nominal": defaults, **({"version": version} if version else {})}
    return _Plan({**data, "pipeline": {"name": made.name, "settings": settings}}, made)


def _function_pipeline(function: SlamFunction, nominal: object, version: str) -> Pipeline:
    name = name_of(function)
    if not callable(function):
        raise DefinitionError(f"expected the name of a pipeline or a function, not {type(function).__name__}")
    if not is_importable(name) or resolved(name) is not function:
        return from_function(function, nominal or getattr(function, "nominal", None), version)
    given = {"nominal": nominal, "version": version}
    return create_imported(name, {setting: value for setting, value in given.items() if value})


def _floated(nominal: object, axes: Mapping[str, Mapping[str, Any]]) -> object:
    """Return defaults with 1 as 1.0 where the ends of an option's range are no whole numbers."""
    if not isinstance(nominal, Mapping):
        return nominal
    floats = {option for option, axis in axes.items() if any(isinstance(end, float) for end in axis.values())}
    return {
        option: float(value) if option in floats and isinstance(value, int) and not isinstance(value, bool) else value
        for option, value in nominal.items()
    }


def _axis(option: str, axis: Any) -> dict[str, Any]:
    if isinstance(axis, Mapping):
        return dict(axis)
    if isinstance(axis, tuple):
        *ends, scale = axis if len(axis) == 3 else (*axis, "linear")
        if len(ends) == 2 and scale in ("log", "linear") and all(isinstance(end, int | float) for end in ends):
            return {"low": ends[0], "high": ends[1], "log": scale == "log"}
    elif isinstance(axis, Iterable) and not isinstance(axis, str):
        return {"values": [value.item() if hasattr(value, "item") else value for value in axis]}
    raise DefinitionError(
        f"the axis of option '{option}' must be (low, high), (low, high, 'log') or a list of values, not {axis!r}"
    )


def _sequences(given: Sequences) -> list[dict[str, str]]:
    if isinstance(given, str | os.PathLike):
        given = [given]
    if not isinstance(given, Mapping):
        paths = [Path(path).expanduser().absolute() for path in given]
        return [{"name": name_from(path.name), "path": str(path)} for path in paths]
    return [{"name": name, "path": str(Path(path).expanduser().absolute())} for name, path in given.items()]


def _refuse_other(study: Study, plan: _Plan) -> None:
    """Raise `DefinitionError` where a stored study has other images, another pipeline or another space."""
    known, space = study.definition, plan.data["space"]
    parts = {
        "sequences": (
            [defined.path for defined in known.sequences],
            [given["path"] for given in plan.data["sequences"]],
        ),
        "pipeline": (known.pipeline.name, plan.data["pipeline"]["name"]),
        "space": (known.space, {option: _AXIS.validate_python(axis) for option, axis in space.items()}),
    }
    differing = [part for part, (stored, wanted) in parts.items() if stored != wanted]
    if differing:
        raise DefinitionError(
            f"study '{study.name}' exists with another {' and another '.join(differing)}; give another name"
        )
