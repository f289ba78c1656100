"""Describe, look up and check the tunable options of a pipeline."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from difflib import get_close_matches

from gtf_tune.errors import DefinitionError, OptionError, first_remedy

OptionValue = bool | int | float | str

_SUGGESTIONS = 3
_LARGEST_WHOLE = 2**63


def option_text(value: object, digits: int = 0) -> str:
    """Return the value of an option as a person types it; ``digits`` significant ones of a fraction, 0 for all."""
    if isinstance(value, bool):
        return "true" if value else "false"
    return f"{value:.{digits}g}" if digits and isinstance(value, float) else str(value)


@dataclass(frozen=True)
class OptionSpec:
    """Describe one tunable option of a pipeline.

    ``name`` is the dotted path, ``choices`` the allowed words of an enumeration (empty otherwise), ``stage`` the part
    of the pipeline that reads the option, ``low`` and ``high`` optional inclusive bounds.
    """

    name: str
    default: OptionValue
    documentation: str = ""
    choices: tuple[str, ...] = ()
    stage: str = ""
    low: float | None = None
    high: float | None = None

    @property
    def kind(self) -> str:
        """Name the type of the option as a user writes it: bool, int, float, str or enum."""
        return "enum" if self.choices else type(self.default).__name__


def _accept_all(_: Mapping[str, OptionValue]) -> None:
    """Accept any combination of values."""


@dataclass(frozen=True)
class OptionTable:
    """Every option of a pipeline, and the check of values against it.

    ``check_together`` receives values that are right one by one and raises `OptionError` where the program refuses them
    (COLMAP's own ``check()``).
    """

    pipeline: str
    specs: Mapping[str, OptionSpec]
    check_together: Callable[[Mapping[str, OptionValue]], None] = field(default=_accept_all, repr=False)

    def check(self, values: Mapping[str, object]) -> dict[str, OptionValue]:
        """Return the values in their canonical types, or raise one `OptionError` that names every fault."""
        checked: dict[str, OptionValue] = {}
        faults: list[OptionError] = []
        for name, value in values.items():
            try:
                checked[name] = self.check_one(name, value)
            except OptionError as error:
                faults.append(error)
        if faults:
            raise OptionError("; ".join(map(str, faults)), remedy=first_remedy(faults))
        self.check_together(checked)
        return dict(sorted(checked.items()))

    def check_one(self, name: str, value: object) -> OptionValue:
        """Return one value in its canonical type, or raise `OptionError` with the nearest valid names."""
        spec = self.specs.get(name)
        if spec is None:
            raise OptionError(self._unknown(name), remedy=("options", self.pipeline))
        return _convert(spec, value)

    def _unknown(self, name: str) -> str:
        near = get_close_matches(name, self.specs, n=_SUGGESTIONS, cutoff=0.5)
        last = name.rsplit(".", 1)[-1]
        near += [known for known in self.specs if known.rsplit(".", 1)[-1] == last and known not in near][:_SUGGESTIONS]
        hint = f"did you mean {' or '.join(map(repr, near))}?" if near else "list the options that it has"
        return f"unknown option '{name}' for pipeline '{self.pipeline}'; {hint}"


def _convert(spec: OptionSpec, value: object) -> OptionValue:
    converted = _convert_type(spec, value)
    if isinstance(converted, int | float) and not isinstance(converted, bool):
        low = float("-inf") if spec.low is None else spec.low
        high = float("inf") if spec.high is None else spec.high
        if not low <= converted <= high:
            raise OptionError(f"option '{spec.name}' must lie in [{low:g}, {high:g}], not {converted!r}")
    return converted


def _convert_type(spec: OptionSpec, value: object) -> OptionValue:
    if isinstance(value, float) and value.is_integer() and spec.kind == "int":
        value = int(value)
    if isinstance(value, int) and abs(value) >= _LARGEST_WHOLE:
        raise OptionError(f"option '{spec.name}' takes numbers of at most 18 digits")
    if isinstance(value, int) and not isinstance(value, bool) and spec.kind == "float":
        value = float(value)
    if isinstance(value, int) and not isinstance(value, bool) and str(value) in spec.choices:
        value = str(value)
    right = value in spec.choices if spec.choices else type(value) is type(spec.default) and value == value
    if not right or not isinstance(value, bool | int | float | str):
        raise OptionError(f"option '{spec.name}' takes {_kind_in_words(spec)}, not {_given(value)}")
    return value


def _given(value: object) -> str:
    return option_text(value) if isinstance(value, bool) else repr(value)


def _kind_in_words(spec: OptionSpec) -> str:
    if spec.choices:
        return "one of " + ", ".join(spec.choices)
    words = {"bool": "true or false", "int": "a whole number", "float": "a number", "str": "a text"}
    return words[spec.kind]


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
