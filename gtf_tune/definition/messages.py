"""Sentences about what is wrong with a definition, one for each place, in the words of the file."""

from collections.abc import Iterator, Mapping
from difflib import get_close_matches
from types import MappingProxyType
from typing import Any

from pydantic import BaseModel, ValidationError

from gtf_tune.definition.model import RangeAxis, StudyDefinition, ValuesAxis
from gtf_tune.errors import did_you_mean

Place = tuple[int | str, ...]

_KINDS = MappingProxyType(
    {
        "bool_type": "true or false",
        "bool_parsing": "true or false",
        "int_type": "a whole number",
        "int_parsing": "a whole number",
        "int_from_float": "a whole number",
        "float_type": "a number",
        "float_parsing": "a number",
        "string_type": "a text",
        "list_type": "a list",
        "dict_type": "a table",
        "model_type": "a table",
        "model_attributes_type": "a table",
    }
)
_AXIS_KEYS = frozenset([*RangeAxis.model_fields, *ValuesAxis.model_fields])


def fault_sentences(
    error: ValidationError, model: type[BaseModel], data: Mapping[str, Any], hints: Mapping[str, str]
) -> list[str]:
    """Return a sentence for every place of the data where something is wrong.

    ``hints`` say, by the name of a section, how to give it where it is missing.
    """
    unquoted = list(_unquoted_names(data)) if model is StudyDefinition else []
    sentences = [_quote(section, name) for section, name in unquoted]
    reported = {(*section, name[0]) for section, name in unquoted}
    faults: dict[Place, list[Any]] = {}
    for fault in error.errors():
        place = _place(fault, data)
        if not any(place[: len(table)] == table for table in reported):
            faults.setdefault(place, []).append(fault)
    for place, found in faults.items():
        others = [fault for fault in found if fault["type"] not in _KINDS and fault["type"] != "literal_error"]
        if others:
            sentences += [_sentence(fault, place, model, hints) for fault in others]
        # Each member of a union has its complaint; a fault inside the member that is meant says more.
        elif not any(len(other) > len(place) and other[: len(place)] == place for other in faults):
            sentences.append(_other_kind(place, found))
    return list(dict.fromkeys(sentences))


def _unquoted_names(data: Mapping[str, Any]) -> Iterator[tuple[Place, tuple[str, ...]]]:
    """Yield section and parts of option names that TOML read as tables in tables, as it does without quotes."""
    for key, axis in _table(data.get("space")).items():
        for path, value in _leaves(_table(axis), (key,)):
            is_table = isinstance(value, Mapping)
            if path[-1] not in _AXIS_KEYS and (is_table or not _is_meant_as_axis(key, _table(axis))):
                yield ("space",), path
    for part in ("options", "nominal"):
        for key, value in _table(_table(data.get("pipeline")).get(part)).items():
            for path, _ in _leaves(_table(value), (key,)):
                yield ("pipeline", part), path


def _leaves(table: Mapping[str, Any], prefix: tuple[str, ...]) -> Iterator[tuple[tuple[str, ...], Any]]:
    """Yield the values in nested tables with their paths; the table of an axis counts as one value."""
    for key, value in table.items():
        inner = _table(value)
        if inner and not _AXIS_KEYS & set(inner):
            yield from _leaves(inner, (*prefix, key))
        else:
            yield (*prefix, key), value


def _is_meant_as_axis(name: str, table: Mapping[str, Any]) -> bool:
    return "." in name or any(get_close_matches(key, _AXIS_KEYS, n=1) for key in table)


def _table(value: object) -> Mapping[str, Any]:
    return value if isinstance(value, Mapping) else {}


def _quote(section: Place, name: tuple[str, ...]) -> str:
    return f"'{dotted((*section, *name))}': write the name in quotes: \"{'.'.join(name)}\" = ..."


def _place(error: Any, data: Mapping[str, Any]) -> Place:
    """Return where in the data an error lies: its location without pydantic's names of the members of unions."""
    parts = error["loc"]
    if parts[:1] == ("space",):
        parts = parts[:2] + parts[3:]
    place: list[int | str] = []
    here: Any = data
    for number, part in enumerate(parts, start=1):
        is_inside = part in here if isinstance(here, Mapping) else isinstance(here, list) and isinstance(part, int)
        if is_inside:
            here = here[part]
        if is_inside or (error["type"] == "missing" and number == len(parts)):
            place.append(part)
    return tuple(place)


def _sentence(error: Any, place: Place, model: type[BaseModel], hints: Mapping[str, str]) -> str:
    where = dotted(place)
    if error["type"] == "extra_forbidden":
        return _unknown_key(place, _known_keys(model, place[:-1], error["loc"]))
    if error["type"] == "missing":
        return f"'{where}' is missing" + (f"; {hints[where]}" if where in hints else "")
    if error["type"] == "too_short":
        return f"'{where}': should not be empty" + (f"; {hints[where]}" if where in hints else "")
    message = error["msg"].removeprefix("Value error, ").replace("Input should be", "should be")
    given = error.get("input")
    shown = f", not {given!r}" if not isinstance(given, dict | list) and "not " not in message else ""
    return f"'{where}': {message}{shown}" if where else message


def _other_kind(place: Place, errors: list[Any]) -> str:
    """Return what a value should be, listing all kinds that a union accepts."""
    kinds = list(dict.fromkeys(_KINDS.get(error["type"]) or _words(error["ctx"]["expected"]) for error in errors))
    if "a number" in kinds and "a whole number" in kinds:
        kinds.remove("a whole number")
    given = errors[0]["input"]
    shown = "a table" if isinstance(given, Mapping) else "a list" if isinstance(given, list) else repr(given)
    listed = " or ".join(", ".join(kinds).rsplit(", ", 1))
    return f"'{dotted(place)}': should be {listed}, not {shown}"


def _words(expected: str) -> str:
    return expected.replace(" or ", ", ")


def dotted(place: Place) -> str:
    """Return a place of a definition as users write it: ``sequences[0].path``, ``space."matching.max_ratio"``."""
    text = ""
    for part in place:
        if isinstance(part, int):
            text += f"[{part}]"
        elif "." in part:
            text += f'."{part}"'
        else:
            text += f".{part}"
    return text.removeprefix(".")


def _unknown_key(place: Place, known: list[str]) -> str:
    hint = did_you_mean(str(place[-1]), known, cutoff=0.55, otherwise=f"known are {', '.join(sorted(known))}")
    return f"unknown key '{dotted(place)}'; {hint}"


def _known_keys(model: type[BaseModel], place: Place, location: tuple[int | str, ...]) -> list[str]:
    """Return the keys of the section at a place, counted from the model that was validated."""
    if model is StudyDefinition and place[:1] == ("space",):
        return list(ValuesAxis.model_fields) if location[2] == "values" else sorted(_AXIS_KEYS)
    for part in place:
        if isinstance(part, str):
            model = _section(model, part)
    return list(model.model_fields)


def _section(model: type[BaseModel], name: str) -> type[BaseModel]:
    field = model.model_fields.get(name)
    if field is None:
        return model
    candidates = [field.annotation, *getattr(field.annotation, "__args__", ())]
    for candidate in candidates:
        if isinstance(candidate, type) and issubclass(candidate, BaseModel):
            return candidate
    return model
