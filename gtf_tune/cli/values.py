"""Read values and pairs from the command line."""

from dataclasses import fields
from pathlib import Path
from typing import TYPE_CHECKING, Any

from gtf_tune.errors import DefinitionError
from gtf_tune.input_files import parse_toml

if TYPE_CHECKING:
    from gtf_tune.sequence.selection import Selection


_MOST_FRAMES = 10**9
# Fields of a selection that have flags of their own, or none.
_OWN_FLAGS = ("cameras", "exclude", "recursive", "rules")


def parse_value(text: str) -> Any:
    """Return the TOML value of a text (1e-3, true, 7; True and FALSE too), or the text itself where it is none."""
    if text.lower() in ("true", "false"):
        return text.lower() == "true"
    try:
        return parse_toml(f"value = {text}")["value"]
    except ValueError:
        return text


def parse_pairs(texts: list[str] | None, flag: str) -> dict[str, Any]:
    """Return the values of several NAME=VALUE, each name given once."""
    return {name: parse_value(value) for name, value in split_pairs(texts, flag).items()}


def split_pairs(texts: list[str] | None, flag: str) -> dict[str, str]:
    """Return the texts after the equals signs of several NAME=VALUE by their names.

    Raises
    ------
    DefinitionError
        One of them is no pair, or a name is given twice.
    """
    pairs = [parse_pair(text, flag) for text in texts or []]
    refuse_repeated([name for name, _ in pairs], flag)
    return dict(pairs)


def refuse_repeated(names: list[str], flag: str) -> None:
    """Raise `DefinitionError` if a name is given twice, of which only the last value would count."""
    for name in names:
        if names.count(name) > 1:
            raise DefinitionError(f"{flag} is given {names.count(name)} times for '{name}'; give it once")


def parse_pair(text: str, flag: str) -> tuple[str, str]:
    """Split NAME=VALUE."""
    name, equals, value = text.partition("=")
    if not equals or not name.strip() or not value.strip():
        raise DefinitionError(f"{flag} takes NAME=VALUE, not '{text}'")
    return name.strip(), value.strip()


def parse_options(texts: list[str] | None, flag: str) -> dict[str, Any]:
    """Return the options that are given as OPTION=VALUE, or as JSON files, which the former overrule."""
    pairs = [text for text in texts or [] if "=" in text]
    files = [_options_of(Path(text), flag) for text in texts or [] if "=" not in text]
    refuse_repeated([name for options in files for name in options], flag)
    return {name: value for options in files for name, value in options.items()} | parse_pairs(pairs, flag)


def _options_of(path: Path, flag: str) -> dict[str, Any]:
    from gtf_tune.definition import read_options

    try:
        return read_options(path)
    except DefinitionError as error:
        raise DefinitionError(f"{flag} takes OPTION=VALUE or a JSON file of options; {error}") from error


def parse_frames(texts: list[str] | None) -> "Selection":
    """Return the selection that several ``--frames KEY=VALUE`` describe, all frames where there are none."""
    from gtf_tune.pipelines.options import option_text
    from gtf_tune.sequence.selection import Selection

    given = parse_pairs(texts, "--frames")
    known = [field.name for field in fields(Selection) if field.name not in _OWN_FLAGS]
    wrong = [name for name in given if name not in known]
    if wrong:
        raise DefinitionError(f"--frames knows {', '.join(known)}, not {', '.join(wrong)}")
    for name, value in given.items():
        if not isinstance(value, int | float) or isinstance(value, bool):
            raise DefinitionError(f"--frames {name} takes a number, not '{option_text(value)}'")
        if abs(value) > _MOST_FRAMES:
            raise DefinitionError(f"--frames {name} takes at most {_MOST_FRAMES:g}")
    return Selection(**given)
