"""Turn the settings of the pipeline ``command`` into a definition, the user's parameters, a version and an identity."""

import os
import shutil
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from gtf_tune.errors import DefinitionError, did_you_mean, numbered
from gtf_tune.input_files import parse_toml, read_input_text
from gtf_tune.pipelines.command.checks import read_command
from gtf_tune.pipelines.command.definition import (
    CommandDefinition,
    ParameterDefinition,
    SequenceFilesDefinition,
    words_of,
)
from gtf_tune.pipelines.command.file_defaults import with_file_defaults
from gtf_tune.pipelines.command.places import RELATIVE_TO, Places, places_of
from gtf_tune.pipelines.command.preset_files import load_preset, preset_names
from gtf_tune.pipelines.command.programs import program_faults, program_version
from gtf_tune.pipelines.command.templates import Value
from gtf_tune.pipelines.file_digest import file_digest
from gtf_tune.pipelines.options import option_text
from gtf_tune.pipelines.run import digest

_MERGED = ("options", "environment", "parameters")
_NOT_RESULTS: Any = {
    "description": True,
    "sources": True,
    "version_command": True,
    "version_pattern": True,
    "parameters": {"__all__": {"documentation", "choices", "default"}},
    "options": {"__all__": {"documentation", "choices", "low", "high"}},
}


@dataclass(frozen=True)
class ResolvedCommand:
    """A definition, what its parameters stand for, and what its results depend on besides options.

    ``identity`` digests the definition, the texts among the parameters and the contents of every file they name.
    """

    source: str
    definition: CommandDefinition
    parameters: Mapping[str, Value]
    identity: str
    version: str


def resolve(settings: Mapping[str, object]) -> ResolvedCommand:
    """Return what settings stand for: a preset or a definition file with parameters, or a whole definition.

    Relative paths are looked for in the folder of ``relative_to``, in that of the definition file and in the current
    one. The identity has them as they are written, so that it does not depend on where they were looked for.

    Raises
    ------
    DefinitionError
        Something is unknown, missing, contradictory or not on this machine; every fault is named.
    """
    file = _definition_file(settings)
    source, base = _base(settings, file)
    own = {name: value for name, value in settings.items() if name not in ("preset", "definition", RELATIVE_TO)}
    data, given = _merged(base, own)
    written, faults = read_command(data)
    places = places_of(settings, file)
    definition = places.located(written)
    parameters: dict[str, Value] = {}
    if not faults or definition != CommandDefinition():
        faults += _unknown(definition, given)
        parameters, parameter_faults = _parameters(definition, given, places)
        faults += parameter_faults
    if not faults:
        definition, faults = with_file_defaults(definition, parameters)
        faults += program_faults(definition, parameters)
    if faults:
        raise DefinitionError(f"pipeline 'command' ({source}): {numbered(faults)}")
    identity = digest(_identity(written.model_copy(update={"options": definition.options}), definition, parameters))
    return ResolvedCommand(source, definition, parameters, identity, program_version(definition, parameters))


def _definition_file(settings: Mapping[str, object]) -> Path | None:
    path = settings.get("definition")
    return None if path is None else places_of(settings).find(str(path))


def _base(settings: Mapping[str, object], file: Path | None) -> tuple[str, dict[str, Any]]:
    preset, path = settings.get("preset"), settings.get("definition")
    if preset is not None and path is not None:
        raise DefinitionError("pipeline 'command': give either 'preset' or 'definition', not both")
    if preset is not None:
        return f"preset '{preset}'", load_preset(str(preset))
    if file is not None:
        return str(path), _read(file)
    if not ("arguments" in settings or "steps" in settings):
        raise DefinitionError(
            "pipeline 'command' needs to know a program: give the setting 'preset' "
            f"(one of {', '.join(preset_names())}), 'definition' (the path of a TOML file), or 'arguments'"
        )
    return "settings", {}


def _read(path: Path) -> dict[str, Any]:
    try:
        return parse_toml(read_input_text(path))
    except (OSError, ValueError) as error:
        raise DefinitionError(f"pipeline 'command': {path} is no readable TOML file ({error})") from error


def _merged(base: dict[str, Any], own: Mapping[str, object]) -> tuple[dict[str, Any], dict[str, object]]:
    """Return the definition with the user's changes, and what is left: values of parameters."""
    data, given = dict(base), {}
    for name, value in own.items():
        if name in _MERGED and isinstance(value, Mapping) and isinstance(data.get(name), Mapping):
            data[name] = {**data[name], **value}
        elif name in CommandDefinition.model_fields:
            data[name] = value
        else:
            given[name] = value
    return data, given


def _unknown(definition: CommandDefinition, given: Mapping[str, object]) -> Iterator[str]:
    known = [*definition.parameters, *CommandDefinition.model_fields]
    for name in given:
        if name not in definition.parameters:
            hint = did_you_mean(name, known, cutoff=0.5, otherwise=f"known are {', '.join(known)}")
            yield f"unknown setting '{name}'; {hint}"


def _parameters(
    definition: CommandDefinition, given: Mapping[str, object], places: Places
) -> tuple[dict[str, Value], list[str]]:
    """Return the value of each parameter that has one, and the faults."""
    values: dict[str, Value] = {}
    faults = []
    for name, parameter in definition.parameters.items():
        value = given.get(name, parameter.default)
        if value is None:
            faults.append(f"the {parameter.kind} '{name}' is missing: {parameter.documentation or 'give it'}")
        elif value != "":
            try:
                values[name] = _parameter(name, parameter, value, places)
            except DefinitionError as error:
                faults.append(str(error))
    return values, faults


def _parameter(name: str, parameter: ParameterDefinition, value: object, places: Places) -> Value:
    if parameter.kind == "arguments":
        if isinstance(value, list | tuple) and all(isinstance(word, str) for word in value):
            return tuple(value)
        raise DefinitionError(f"'{name}' must be a list of words, not {value!r}")
    if not isinstance(value, str | int | float):
        raise DefinitionError(f"'{name}' must be a {parameter.kind}, not {value!r}")
    if parameter.choices and str(value) not in parameter.choices:
        raise DefinitionError(f"'{name}' must be one of {', '.join(parameter.choices)}, not {value!r}")
    if parameter.kind == "text":
        return option_text(value)
    if parameter.kind == "executable":
        return _executable(name, str(value), places)
    path = places.find(str(value))
    if path.is_file() if parameter.kind == "file" else path.is_dir():
        return path
    raise DefinitionError(f"'{name}': there is no {parameter.kind} {path}")


def _executable(name: str, value: str, places: Places) -> Path:
    found = shutil.which(places.find(value) if os.path.dirname(value) else value)
    if found is None:
        raise DefinitionError(f"'{name}': there is no program '{value}' that can be run; install it or give its path")
    return Path(found).absolute()


def _identity(
    written: CommandDefinition, definition: CommandDefinition, parameters: Mapping[str, Value]
) -> dict[str, object]:
    """Return what results depend on: the definition as it is ``written``, and the files that it names."""
    by_kind = {name: parameter.kind for name, parameter in definition.parameters.items()}
    values = {
        name: file_digest(Path(str(value))) if by_kind[name] == "file" else str(value)
        for name, value in parameters.items()
        if by_kind[name] not in ("executable", "folder")
    }
    programs = [next(words_of(step.arguments)) for step in written.all_steps]  # a relative one is part of the version
    words = [word for step in definition.all_steps for word in list(words_of(step.arguments))[1:]] + programs
    words += [file.link for file in definition.files]
    words += [str(Path(file.template).absolute()) for file in definition.settings_files]
    files = {word: file_digest(Path(word)) for word in words if Path(word).is_absolute() and Path(word).is_file()}
    dumped = written.model_dump(mode="json", exclude=_NOT_RESULTS)
    if written.output.duplicates == "error":  # keys of stored runs are older than this field
        del dumped["output"]["duplicates"]
    if written.images.channels == 1:
        del dumped["images"]["channels"]
    if written.sequence_files == SequenceFilesDefinition():
        del dumped["sequence_files"]
    for file in dumped["settings_files"]:
        if not file["step"]:
            del file["step"]
    for step in dumped["steps"]:  # likewise; with several cameras the runs have keys of their own
        del step["each_camera"]
    return {"definition": dumped, "values": values, "files": files}
