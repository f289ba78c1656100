"""Fill the placeholders of a command, a file or a setting; nothing in a template is evaluated."""

import contextlib
import string
from collections.abc import Mapping, Sequence
from pathlib import Path

from gtf_tune.errors import DefinitionError, RunError

Value = bool | int | float | str | Path | tuple[str, ...]
"""What a placeholder can stand for; a tuple becomes several arguments."""

_FORMATTER = string.Formatter()
NAMED = ("option", "settings_file", "file")
"""Placeholders after whose colon stands a name instead of a format."""


class NoValueError(RunError):
    """Signal a placeholder that has no value in this run."""


def fields_of(template: str) -> list[tuple[str, str]]:
    """Return the placeholders of a template, each with what stands after its colon.

    Raises
    ------
    DefinitionError
        A brace is not closed, or a placeholder is more than a name.
    """
    try:
        parts = list(_FORMATTER.parse(template))
    except ValueError as error:
        raise DefinitionError(f"'{template}' is no template ({error}); double braces stand for braces") from error
    fields = [(name, detail or "") for _, name, detail, _ in parts if name is not None]
    for name, detail in fields:
        if not name.isidentifier() or "{" in detail:
            raise DefinitionError(f"'{template}' has a placeholder '{{{name}}}', which is no name")
    return fields


def filled(template: str, values: Mapping[str, Value], boolean_words: Sequence[str] = ("false", "true")) -> str:
    """Return a template with its placeholders filled.

    Options, settings files and files have keys such as ``option:NAME``. Other placeholders may have a format after the
    colon, as in ``{timestamp_s:.6f}``; ``d`` rounds.

    Raises
    ------
    NoValueError
        A placeholder has no value.
    """
    text = ""
    for literal, name, detail, _ in _FORMATTER.parse(template):
        text += literal
        if name is None:
            continue
        key, form = (f"{name}:{detail}", "") if name in NAMED and detail else (name, detail or "")
        text += _formatted(value_of(key, values), form, boolean_words)
    return text


def filled_arguments(
    arguments: Sequence[str | Sequence[str]], values: Mapping[str, Value], boolean_words: Sequence[str]
) -> list[str]:
    """Return the words of a command; a group that lacks a value is left out, a placeholder of several words spread.

    Raises
    ------
    NoValueError
        A placeholder outside a group has no value.
    """
    words: list[str] = []
    for argument in arguments:
        if isinstance(argument, str):
            words += _spread(argument, values, boolean_words)
            continue
        try:
            words += [word for part in argument for word in _spread(part, values, boolean_words)]
        except NoValueError:
            continue
    return words


def is_format(form: str) -> bool:
    """Return whether a whole number, a fraction or a text can be written in a format."""
    for value in (1, 1.0, "1"):
        with contextlib.suppress(TypeError, ValueError):
            format(value, form)
            return True
    return False


def value_of(key: str, values: Mapping[str, Value]) -> Value:
    """Return what a placeholder stands for, or raise `NoValueError` with what to do."""
    if key in values:
        return values[key]
    if key.startswith("camera"):
        raise NoValueError(
            f"the program wants {{{key}}}, but the intrinsics of the sequence are unknown or of a model without it; "
            "give the camera of the sequence"
        )
    if key == "fps":
        raise NoValueError("the program wants {fps}, but the sequence has no timestamps; give them")
    raise NoValueError(f"the program wants {{{key}}}, which has no value here; give the parameter '{key}'")


def _spread(template: str, values: Mapping[str, Value], boolean_words: Sequence[str]) -> list[str]:
    fields = fields_of(template)
    if len(fields) == 1 and template == f"{{{fields[0][0]}}}":
        value = value_of(fields[0][0], values)
        if isinstance(value, tuple):
            return list(value)
    return [filled(template, values, boolean_words)]


def _formatted(value: Value, form: str, boolean_words: Sequence[str]) -> str:
    if isinstance(value, bool):
        return boolean_words[value]
    if isinstance(value, tuple):
        return " ".join(value)
    if isinstance(value, float) and form == "d":
        return str(round(value))
    if form:
        try:
            return format(value, form)
        except (TypeError, ValueError) as error:
            raise RunError(f"the format '{form}' does not fit {value!r}; correct the placeholder") from error
    return repr(value) if isinstance(value, float) else str(value)
