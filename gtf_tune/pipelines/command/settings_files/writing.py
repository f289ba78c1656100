"""Write values into settings files by dotted path, whatever their format."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path
from types import MappingProxyType

from gtf_tune.errors import DefinitionError, did_you_mean
from gtf_tune.pipelines.command.settings_files import ini_lines, json_spans, toml_lines, yaml_lines

SettingValue = bool | int | float | str


@dataclass(frozen=True)
class SettingsFormat:
    """Read and edit the text of one file format.

    ``keys(text)`` lists all dotted paths, ``values(text)`` those that hold a single value with it,
    ``replace(text, key, value)`` returns the text with another value there, ``add(text, key, value)`` the text with a
    value that it did not have. The last two raise
    `DefinitionError` where that cannot be done without touching anything else.
    """

    keys: Callable[[str], tuple[str, ...]]
    values: Callable[[str], Mapping[str, SettingValue]]
    replace: Callable[[str, str, SettingValue], str]
    add: Callable[[str, str, SettingValue], str]


FORMATS: Mapping[str, SettingsFormat] = MappingProxyType(
    {
        "yaml": SettingsFormat(yaml_lines.keys, yaml_lines.values, yaml_lines.replace, yaml_lines.add),
        "ini": SettingsFormat(ini_lines.keys, ini_lines.values, ini_lines.replace, ini_lines.add),
        "json": SettingsFormat(json_spans.keys, json_spans.values, json_spans.replace, json_spans.add),
        "toml": SettingsFormat(toml_lines.keys, toml_lines.values, toml_lines.replace, toml_lines.add),
    }
)
"""The formats by name; ``yaml`` includes OpenCV's ``%YAML:1.0`` files."""

_SUFFIXES = MappingProxyType(
    {
        ".yaml": "yaml",
        ".yml": "yaml",
        ".ini": "ini",
        ".cfg": "ini",
        ".conf": "ini",
        ".json": "json",
        ".toml": "toml",
    }
)


def format_of(path: Path) -> str:
    """Return the name of the format that the suffix of a file stands for.

    Raises
    ------
    DefinitionError
        The suffix stands for none.
    """
    found = _SUFFIXES.get(path.suffix.lower())
    if found is None:
        raise DefinitionError(
            f"{path}: the format of a settings file is known from {', '.join(_SUFFIXES)}, not '{path.suffix}'; "
            f"give 'format', one of {', '.join(FORMATS)}"
        )
    return found


def missing_keys(text: str, form: str, wanted: Mapping[str, SettingValue]) -> list[str]:
    """Return one sentence for each wanted key that the text does not hold, with the nearest keys that it does."""
    present = FORMATS[form].keys(text)
    return [_missing(key, present) for key in wanted if key not in present]


def write_values(text: str, form: str, values: Mapping[str, SettingValue], add_missing: bool = False) -> str:
    """Return the text with the values written at their dotted paths.

    Raises
    ------
    DefinitionError
        A key is missing and may not be added, or holds something else than a single value; every fault is named.
    """
    editor = FORMATS[form]
    faults: list[str] = []
    for key, value in values.items():
        present = editor.keys(text)
        try:
            if key in present:
                text = editor.replace(text, key, value)
            elif add_missing:
                text = editor.add(text, key, value)
            else:
                faults.append(_missing(key, present))
        except DefinitionError as error:
            faults.append(str(error))
    if faults:
        raise DefinitionError("; ".join(faults))
    return text


def _missing(key: str, present: tuple[str, ...]) -> str:
    hint = did_you_mean(key, present, cutoff=0.5, otherwise="add it to the file")
    return f"the settings file has no key '{key}'; {hint}"
