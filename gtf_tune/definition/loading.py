"""Read study definitions; one message names every fault of a file."""

import json
from collections.abc import Iterable, Iterator, Mapping
from pathlib import Path
from types import MappingProxyType
from typing import Any, TypeVar

from pydantic import BaseModel, ValidationError

from gtf_tune.definition.messages import fault_sentences
from gtf_tune.definition.model import StudyDefinition
from gtf_tune.errors import DefinitionError, numbered
from gtf_tune.input_files import parse_json, parse_toml, read_input_text

_Section = TypeVar("_Section", bound=BaseModel)


def read_toml(path: Path, kind: str = "a study definition") -> dict[str, Any]:
    """Return the contents of a TOML file of some ``kind``, or raise `DefinitionError` with the line of the fault."""
    try:
        return parse_toml(read_input_text(path))
    except FileNotFoundError as error:
        raise DefinitionError(f"{path}: there is no such file; give the path of {kind} (TOML)") from error
    except (OSError, UnicodeDecodeError) as error:
        reason = error.strerror if isinstance(error, OSError) else error
        raise DefinitionError(f"{path}: cannot be read as text ({reason}); give {kind} (TOML)") from error
    except ValueError as error:
        raise DefinitionError(f"{path}: not valid TOML: {error}; correct that line") from error


def read_options(path: Path) -> dict[str, Any]:
    """Return the options of a JSON file by their dotted paths; tables in tables are parts of a path.

    Raises
    ------
    DefinitionError
        It cannot be read, or holds something else.
    """
    try:
        found = parse_json(read_input_text(path))
    except (OSError, ValueError) as error:
        reason = error.strerror if isinstance(error, OSError) else error
        raise DefinitionError(
            f"'{path}' is no JSON file of options ({reason}); export one from a study", remedy=("options file",)
        ) from error
    if not isinstance(found, dict):
        raise DefinitionError(f"'{path}' should hold an object of options, not {str(found)[:40]!r}")
    return dict(_dotted(found))


def _dotted(tree: dict[str, Any], prefix: str = "") -> Iterator[tuple[str, Any]]:
    for name, value in tree.items():
        if isinstance(value, dict):
            yield from _dotted(value, f"{prefix}{name}.")
        else:
            yield f"{prefix}{name}", value


def load_definition(path: Path) -> StudyDefinition:
    """Return the definition in a TOML file."""
    return definition_from_dict(read_toml(path), source=str(path))


def definition_from_dict(
    data: Mapping[str, Any],
    source: str = "definition",
    faults: Iterable[str] = (),
    hints: Mapping[str, str] = MappingProxyType({}),
) -> StudyDefinition:
    """Return a checked definition, or raise one `DefinitionError` that names all faults.

    ``faults`` are sentences that the caller has already found in the same data; ``hints`` say, by the name of a
    section, how to give it where it is missing.
    """
    found: list[str] = []
    definition = None
    try:
        definition = StudyDefinition.model_validate(data)
    except ValidationError as error:
        found = fault_sentences(error, StudyDefinition, data, hints)
    found += [fault for fault in faults if fault not in found]
    if definition is None or found:
        raise DefinitionError(f"{source}: {numbered(found)}")
    return definition


def section_from_dict(model: type[_Section], data: Mapping[str, Any], source: str) -> _Section:
    """Return one checked section of a definition, or raise one `DefinitionError` that names all faults."""
    try:
        return model.model_validate(data)
    except ValidationError as error:
        raise DefinitionError(f"{source}: {numbered(fault_sentences(error, model, data, {}))}") from error


def dump_definition(definition: StudyDefinition) -> str:
    """Return the definition as canonical JSON, the form in which the database keeps it."""
    return json.dumps(definition.model_dump(mode="json"), sort_keys=True)
