"""Check the settings of a pipeline: everything besides options that its results depend on."""

from collections.abc import Mapping
from dataclasses import dataclass
from difflib import get_close_matches

from gtf_tune.errors import DefinitionError
from gtf_tune.pipelines.options import option_text


@dataclass(frozen=True)
class Setting:
    """Describe one setting: its default and, where it is not free text, the allowed words."""

    default: str
    choices: tuple[str, ...] = ()


def read_settings(pipeline: str, known: Mapping[str, Setting], given: Mapping[str, object]) -> dict[str, str]:
    """Return every known setting as text, with defaults filled in.

    Raises
    ------
    DefinitionError
        A setting is unknown or has a value that it cannot have; all faults are named at once.
    """
    faults = [_fault(known, name, value) for name, value in given.items()]
    if any(faults):
        raise DefinitionError(f"pipeline '{pipeline}': " + "; ".join(fault for fault in faults if fault))
    values = {name: setting.default for name, setting in known.items()}
    return values | {name: option_text(value) for name, value in given.items()}


def _fault(known: Mapping[str, Setting], name: str, value: object) -> str:
    setting = known.get(name)
    if setting is None:
        near = get_close_matches(name, known, n=1, cutoff=0.5)
        hint = f"did you mean '{near[0]}'" if near else f"it has {', '.join(known)}"
        return f"unknown setting '{name}'; {hint}"
    if not isinstance(value, str | int | float):
        return f"setting '{name}' must be a short value, not {value!r}"
    if setting.choices and option_text(value) not in setting.choices:
        return f"setting '{name}' must be one of {', '.join(setting.choices)}, not {value!r}"
    return ""
