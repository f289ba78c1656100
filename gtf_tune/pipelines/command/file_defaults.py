"""Take the defaults of options from the settings files that hold them."""

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

from gtf_tune.errors import DefinitionError, OptionError
from gtf_tune.input_files import read_input
from gtf_tune.pipelines.command.definition import CommandDefinition, OptionDefinition, SettingsFileDefinition
from gtf_tune.pipelines.command.settings_files import FORMATS, SettingValue, format_of, missing_keys
from gtf_tune.pipelines.command.templates import NoValueError, Value, filled
from gtf_tune.pipelines.options import OptionSpec, OptionTable, OptionValue


@dataclass(frozen=True)
class _Template:
    """A settings file that a definition names: its path, format and text."""

    path: Path
    form: str
    text: str


def with_file_defaults(
    definition: CommandDefinition, parameters: Mapping[str, Value]
) -> tuple[CommandDefinition, list[str]]:
    """Return the definition with the defaults that its settings files hold, and one sentence for each fault in them."""
    options, faults = dict(definition.options), []
    for file in definition.settings_files:
        mine = {name: option for name, option in options.items() if option.key and option.file in ("", file.name)}
        try:
            template = _template(file, parameters)
            present = FORMATS[template.form].values(template.text)
            wanted = {**{option.key: option.default for option in mine.values()}, **file.values}
            missing = [] if file.add_missing else missing_keys(template.text, template.form, wanted)
        except (OSError, DefinitionError, NoValueError) as error:
            faults.append(f"settings file '{file.name}': {error}")
            continue
        faults += [f"{template.path}: {fault}" for fault in missing]
        for name, option in mine.items():
            try:
                default = _default(name, option, present, definition.boolean_words)
            except OptionError as error:
                faults.append(f"{template.path}: {error}")
            else:
                options[name] = option.model_copy(update={"default": default})
    return definition.model_copy(update={"options": options}), faults


def _template(file: SettingsFileDefinition, parameters: Mapping[str, Value]) -> _Template:
    path = Path(filled(file.template, parameters))
    form = file.format or format_of(path)
    return _Template(path, form, read_input(path).decode("utf-8", "surrogateescape"))


def _default(
    name: str, option: OptionDefinition, present: Mapping[str, SettingValue], boolean_words: tuple[str, str]
) -> OptionValue:
    value = present.get(option.key, option.default)
    if isinstance(option.default, bool) and value in (0, 1):
        value = bool(value)
    elif isinstance(option.default, bool) and value in boolean_words:
        value = value == boolean_words[1]
    spec = OptionSpec(name, option.default, "", option.choices, "", option.low, option.high)
    return OptionTable("command", {name: spec}).check_one(name, value)
