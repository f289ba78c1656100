"""Bounds of what a new definition may ask for; stored ones are read whatever they ask for."""

from collections.abc import Iterator, Mapping
from types import MappingProxyType
from typing import Any

from gtf_tune.definition.messages import dotted
from gtf_tune.definition.model import RangeAxis, StudyDefinition
from gtf_tune.errors import DefinitionError, numbered

_MOST = MappingProxyType(
    {
        "gtf.noisy_runs": 1000,
        "gtf.rpe_delta": 1e9,
        "side_metric.rpe_delta": 1e9,
        "sequences.start": 10**9,
        "sequences.stop": 10**9,
        "sequences.stride": 10**9,
        "sequences.max_frames": 10**9,
        "sequences.rate_hz": 1e9,
        "sequences.max_image_size": 10**6,
    }
)
_LEAST = MappingProxyType(
    {
        "gtf.rpe_delta": 1e-9,
        "side_metric.rpe_delta": 1e-9,
        "sequences.rate_hz": 1e-9,
        "limits.run_timeout_s": 1e-3,
        "limits.run_memory_gb": 1e-3,
    }
)
_MOST_STEPS = 10**6
_LARGEST_WHOLE = 2**63
_DEEPEST = 50


def refuse_unbounded(data: Mapping[str, Any], source: str) -> None:
    """Raise `DefinitionError` if data nest without measure or contain whole numbers that nothing can take."""
    faults = list(_unbounded(data, ()))
    if faults:
        raise DefinitionError(f"{source}: {numbered(faults)}")


def _unbounded(value: object, place: tuple[int | str, ...]) -> Iterator[str]:
    if len(place) > _DEEPEST:
        yield f"'{dotted(place[:3])}': values are nested too deeply"
    elif isinstance(value, Mapping):
        for name, inner in value.items():
            yield from _unbounded(inner, (*place, name))
    elif isinstance(value, list):
        for number, inner in enumerate(value):
            yield from _unbounded(inner, (*place, number))
    elif isinstance(value, int) and abs(value) >= _LARGEST_WHOLE:
        yield f"'{dotted(place)}': should be a number of at most 18 digits"


def bound_faults(definition: StudyDefinition) -> list[str]:
    """Return a sentence for every number of a definition that is too small or too large to be meant."""
    faults = [fault for place, value in _numbers(definition) if (fault := _outside(place, value))]
    for name, axis in definition.space.items():
        if isinstance(axis, RangeAxis) and axis.step is not None and (axis.high - axis.low) / axis.step > _MOST_STEPS:
            faults.append(f"'{dotted(('space', name, 'step'))}': should divide the range into at most 1e6 steps")
    return faults


def _numbers(definition: StudyDefinition) -> Iterator[tuple[str, float]]:
    sections = [(name, getattr(definition, name)) for name in ("gtf", "side_metric", "limits")]
    for name, section in [*sections, *(("sequences", sequence) for sequence in definition.sequences)]:
        for field, value in section:
            if isinstance(value, int | float) and field != "noisy_runs":
                yield f"{name}.{field}", value
    yield "gtf.noisy_runs", definition.gtf.noisy_runs_max


def _outside(place: str, value: float) -> str:
    if value > _MOST.get(place, value):
        return f"'{place}': should be at most {_MOST[place]:g}, not {value:g}"
    return f"'{place}': should be at least {_LEAST[place]:g}, not {value:g}" if value < _LEAST.get(place, value) else ""
