"""Find everything that is wrong with the definition of a command, before anything runs."""

import re
from collections.abc import Iterator, Mapping
from pathlib import PurePosixPath
from typing import Any

from pydantic import ValidationError

from gtf_tune.errors import DefinitionError
from gtf_tune.pipelines.command.definition import (
    FRAME_FIELDS,
    RUN_FIELDS,
    CommandDefinition,
    OptionDefinition,
    option_templates_of,
    templates_of,
    words_of,
)
from gtf_tune.pipelines.command.templates import NAMED, fields_of, is_format

_NAME = re.compile(r"[a-z][a-z0-9_]*")
_STEP_NAME = re.compile(r"[A-Za-z0-9_-]{1,60}")
_IMAGE_SUFFIXES = (".pgm", ".png")


def read_command(data: Mapping[str, Any]) -> tuple[CommandDefinition, list[str]]:
    """Return the definition that tables stand for, and one sentence for each of their faults.

    With faults in single values the definition is an empty one.
    """
    try:
        definition = CommandDefinition.model_validate(data)
    except ValidationError as error:
        return CommandDefinition(), list(dict.fromkeys(_sentence(fault) for fault in error.errors()))
    return definition, list(_faults(definition))


def _sentence(error: Any) -> str:
    where = ".".join(str(part) for part in error["loc"])
    if error["type"] == "extra_forbidden":
        return f"unknown key '{where}'"
    if error["type"] == "missing":
        return f"'{where}' is missing"
    return f"'{where}': {error['msg'].removeprefix('Value error, ').replace('Input should be', 'should be')}"


def _faults(definition: CommandDefinition) -> Iterator[str]:
    if bool(definition.arguments) == bool(definition.steps):
        yield "give either 'arguments' (one program) or 'steps' (several)"
    yield from _step_faults(definition)
    yield from _parameter_faults(definition)
    yield from _path_faults(definition)
    for variable in definition.environment:
        if not variable or "=" in variable or "\0" in variable:
            yield f"environment: no variable can be called {variable!r}"
    try:
        re.compile(definition.version_pattern)
    except re.error as error:
        yield f"version_pattern: '{definition.version_pattern}' is no regular expression ({error})"
    template_faults = list(_template_faults(definition))
    yield from template_faults
    if not template_faults:
        yield from _settings_file_faults(definition)
        yield from _option_faults(definition)


def _step_faults(definition: CommandDefinition) -> Iterator[str]:
    names = [step.name for step in definition.steps]
    if len(set(names)) < len(names):
        yield "steps must have different names"
    for step in definition.steps:
        if not _STEP_NAME.fullmatch(step.name):
            yield f"a step is called by letters, digits, '_' and '-', not '{step.name}'"
        if not step.arguments:
            yield f"step '{step.name}' has no arguments"
    cached = [step.cached for step in definition.steps]
    if cached != sorted(cached, reverse=True):
        yield "cached steps must come before all others, because only their results are carried on"


def _parameter_faults(definition: CommandDefinition) -> Iterator[str]:
    taken = (
        (RUN_FIELDS - {"sequence"})
        | FRAME_FIELDS
        | set(CommandDefinition.model_fields)
        | {"preset", "definition", "value"}
    )
    for name, parameter in definition.parameters.items():
        if not _NAME.fullmatch(name) or name in taken:
            yield f"a parameter cannot be called '{name}'; take another name of small letters, digits and '_'"
        if parameter.default is not None and isinstance(parameter.default, tuple) != (parameter.kind == "arguments"):
            yield f"the default of parameter '{name}' does not fit its kind '{parameter.kind}'"


def _path_faults(definition: CommandDefinition) -> Iterator[str]:
    places = [("images.folder", definition.images.folder), ("output.path", definition.output.path)]
    places += [("folders", folder) for folder in definition.folders]
    places += [("a file", file.path) for file in definition.files]
    places += [("a settings file", file.path) for file in definition.settings_files if file.path]
    places += [("sequence_files", path) for path in definition.sequence_files.unchanged]
    places += [("sequence_files", path) for path in definition.sequence_files.noisy]
    for place, path in places:
        if not path or PurePosixPath(path).is_absolute() or ".." in PurePosixPath(path).parts:
            yield f"{place}: the path '{path}' must lie inside the workspace"
    if not definition.images.name.endswith(_IMAGE_SUFFIXES):
        yield f"images.name: '{definition.images.name}' must end in {' or '.join(_IMAGE_SUFFIXES)}"


def _template_faults(definition: CommandDefinition) -> Iterator[str]:
    known = RUN_FIELDS | set(definition.parameters)
    for place, template, extra in (*templates_of(definition), *option_templates_of(definition)):
        try:
            fields = fields_of(template)
        except DefinitionError as error:
            yield f"{place}: {error}"
            continue
        for name, detail in fields:
            shown = f"{{{name}{':' if detail else ''}{detail}}}"
            if name not in known | extra:
                yield f"{place}: unknown placeholder '{shown}'; double braces stand for braces"
            elif name == "option" and detail not in definition.options:
                yield f"{place}: '{shown}' names no option of the definition"
            elif name == "file" and detail not in {file.path for file in definition.files}:
                yield f"{place}: '{shown}' names no file of the definition"
            elif name == "settings_file" and not _has_settings_file(definition, detail):
                yield f"{place}: '{shown}' names no settings file of the definition"
            elif name not in NAMED and not is_format(detail):
                yield f"{place}: '{shown}' has no format that numbers or texts can be written in"


def _has_settings_file(definition: CommandDefinition, name: str) -> bool:
    names = [file.name for file in definition.settings_files]
    return name in names if name else len(names) == 1


def _option_faults(definition: CommandDefinition) -> Iterator[str]:
    readers = _readers(definition)
    listing = {
        step.name
        for step in definition.all_steps
        if any(("options", "") in fields_of(word) for word in words_of(step.arguments))
    }
    cached = {step.name for step in definition.steps if step.cached}
    for name, option in definition.options.items():
        steps = {step.name for step in definition.all_steps}
        if option.step and option.step not in steps:
            yield f"option '{name}': there is no step '{option.step}'; the steps are {', '.join(sorted(steps))}"
        if option.key and not _has_settings_file(definition, option.file):
            yield f"option '{name}': its key belongs to no settings file; name one as 'file'"
        elif not option.key and name not in readers and not (listing & {option.step} if option.step else listing):
            yield f"option '{name}' reaches no program: write {{options}} or {{option:{name}}}, or give its key"
        read_by = readers.get(name, set()) | ({_step_of_file(definition, option.file)} if option.key else set())
        if option.step and cached and read_by - {option.step}:
            yield f"option '{name}' is read outside step '{option.step}', so it can belong to no single step"
        yield from _value_faults(name, option)


def _step_of_file(definition: CommandDefinition, name: str) -> str:
    """Return the only step that reads a settings file, or nothing where all may."""
    return next((file.step for file in definition.settings_files if name in ("", file.name)), "")


def _settings_file_faults(definition: CommandDefinition) -> Iterator[str]:
    """Say which settings files of one step are read elsewhere."""
    readers: dict[str, set[str]] = {}
    for place, template, _ in templates_of(definition):
        for name, detail in fields_of(template):
            if name == "settings_file":
                readers.setdefault(detail or definition.settings_files[0].name, set()).add(place)
    for file in definition.settings_files:
        if file.step and file.step not in {step.name for step in definition.all_steps}:
            yield f"settings file '{file.name}': there is no step '{file.step}'"
        elif file.step and (others := readers.get(file.name, set()) - {f"step '{file.step}'"}):
            yield f"settings file '{file.name}' is of step '{file.step}' but also read by {', '.join(sorted(others))}"


def _readers(definition: CommandDefinition) -> dict[str, set[str]]:
    """Return the steps that read each ``{option:NAME}``; an empty name stands for files and the environment."""
    readers: dict[str, set[str]] = {}
    for place, template, _ in templates_of(definition):
        reader = place.removeprefix("step '").removesuffix("'") if place.startswith("step '") else ""
        for name, detail in fields_of(template):
            if name == "option":
                readers.setdefault(detail, set()).add(reader)
    return readers


def _value_faults(name: str, option: OptionDefinition) -> Iterator[str]:
    if option.choices and not isinstance(option.default, str):
        yield f"option '{name}': choices are for texts only"
    elif option.choices and option.default not in option.choices:
        yield f"option '{name}': its default {option.default!r} is not among its choices"
    if isinstance(option.default, int | float) and not isinstance(option.default, bool):
        low = float("-inf") if option.low is None else option.low
        high = float("inf") if option.high is None else option.high
        if not low <= option.default <= high:
            yield f"option '{name}': its default {option.default!r} lies outside [{low:g}, {high:g}]"
