"""Read study definitions, and name every fault of a file in one message."""

import json
import tomllib
from collections.abc import Iterable, Mapping
from difflib import get_close_matches
from pathlib import Path
from typing import Any, TypeVar

from pydantic import BaseModel, ValidationError

from gtf_tune.definition.model import StudyDefinition
from gtf_tune.definition.space import RangeAxis
from gtf_tune.errors import DefinitionError

_Section = TypeVar("_Section", bound=BaseModel)

_DISCRIMINATOR_TAGS = {"range", "values", "int", "float", "str", "NoisyRuns", "CameraDefinition", "constrained-int"}


def read_toml(path: Path) -> dict[str, Any]:
    """Return the contents of a TOML file, or raise `DefinitionError` with the line of the fault."""
    try:
        return tomllib.loads(path.read_text(encoding="utf-8"))
    except FileNotFoundError as error:
        raise DefinitionError(f"{path}: there is no such file; give the path of a study definition (TOML)") from error
    except (OSError, UnicodeDecodeError) as error:
        raise DefinitionError(f"{path}: cannot be read as text ({error}); give a study definition (TOML)") from error
    except tomllib.TOMLDecodeError as error:
        raise DefinitionError(f"{path}: not valid TOML: {error}; mend that line") from error


def load_definition(path: Path) -> StudyDefinition:
    """Return the definition that a TOML file holds."""
    return definition_from_dict(read_toml(path), source=str(path))


def definition_from_dict(
    data: Mapping[str, Any], source: str = "definition", faults: Iterable[str] = ()
) -> StudyDefinition:
    """Return a checked definition, or raise one `DefinitionError` that names all faults.

    ``faults`` are sentences that the caller has already found in the same data.
    """
    found: list[str] = []
    definition = None
    try:
        definition = StudyDefinition.model_validate(data)
    except ValidationError as error:
        found = list(dict.fromkeys(_sentence(one, data) for one in error.errors()))
    found += [fault for fault in faults if fault not in found]
    if definition is None or found:
        raise DefinitionError(f"{source}: {_numbered(found)}")
    return definition


def section_from_dict(model: type[_Section], data: Mapping[str, Any], source: str) -> _Section:
    """Return one checked section of a definition, or raise one `DefinitionError` that names all faults."""
    try:
        return model.model_validate(data)
    except ValidationError as error:
        raise DefinitionError(f"{source}: {_numbered([_sentence(one, data) for one in error.errors()])}") from error


def dump_definition(definition: StudyDefinition) -> str:
    """Return the definition as canonical JSON, the form in which the database keeps it."""
    return json.dumps(definition.model_dump(mode="json"), sort_keys=True)


def _numbered(faults: list[str]) -> str:
    if len(faults) == 1:
        return faults[0]
    listed = "; ".join(f"({number}) {fault}" for number, fault in enumerate(faults, start=1))
    return f"{len(faults)} faults: {listed}"


def _sentence(error: Any, data: Mapping[str, Any]) -> str:
    place = [part for part in error["loc"] if part not in _DISCRIMINATOR_TAGS or part in _keys_at(data, error["loc"])]
    where = _dotted(place)
    if error["type"] == "extra_forbidden":
        return _unknown_key(place)
    if error["type"] == "missing":
        return f"'{where}' is missing"
    message = error["msg"].removeprefix("Value error, ").replace("Input should be", "should be")
    given = error.get("input")
    shown = f", not {given!r}" if not isinstance(given, dict | list) and "not " not in message else ""
    return f"'{where}': {message}{shown}" if where else message


def _keys_at(data: object, place: tuple[int | str, ...]) -> set[str]:
    keys: set[str] = set()
    for part in place:
        if isinstance(data, Mapping):
            keys |= {str(key) for key in data}
            data = data.get(part, data)
        elif isinstance(data, list) and isinstance(part, int):
            data = data[part]
    return keys


def _dotted(place: list[int | str]) -> str:
    text = ""
    for part in place:
        if isinstance(part, int):
            text += f"[{part}]"
        elif "." in part:
            text += f'."{part}"'
        else:
            text += f".{part}"
    return text.removeprefix(".")


def _unknown_key(place: list[int | str]) -> str:
    name = str(place[-1])
    known = _known_keys(place[:-1])
    near = get_close_matches(name, known, n=2, cutoff=0.55)
    hint = (
        f"did you mean {' or '.join(repr(one) for one in near)}?" if near else f"known are {', '.join(sorted(known))}"
    )
    return f"unknown key '{_dotted(place)}'; {hint}"


def _known_keys(place: list[int | str]) -> list[str]:
    model: type[BaseModel] = StudyDefinition
    for part in place:
        if isinstance(part, str):
            model = _section(model, part)
    return list(model.model_fields)


def _section(model: type[BaseModel], name: str) -> type[BaseModel]:
    if model is StudyDefinition and name == "space":
        return RangeAxis
    field = model.model_fields.get(name)
    if field is None:
        return model
    candidates = [field.annotation, *getattr(field.annotation, "__args__", ())]
    for candidate in candidates:
        if isinstance(candidate, type) and issubclass(candidate, BaseModel):
            return candidate
    return model
