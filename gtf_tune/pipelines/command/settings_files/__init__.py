"""Write values into a copy of a program's settings file and leave every other byte as it is."""

from gtf_tune.pipelines.command.settings_files.writing import (
    FORMATS,
    SettingsFormat,
    SettingValue,
    format_of,
    missing_keys,
    write_values,
)

__all__ = ["FORMATS", "SettingValue", "SettingsFormat", "format_of", "missing_keys", "write_values"]
