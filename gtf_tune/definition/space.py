"""Describe one axis of the search space: a range or an explicit list of values."""

from typing import Annotated, Self

from pydantic import Discriminator, Field, Tag, model_validator

from gtf_tune.definition.base import Section

AxisValue = bool | int | float | str


class RangeAxis(Section):
    """Search an option between two bounds.

    ``points`` is how many values a grid takes on the axis, ``step`` a spacing that every sampler keeps to (linear axes
    only).
    """

    low: int | float
    high: int | float
    log: bool = False
    step: int | float | None = Field(default=None, gt=0)
    points: int = Field(default=9, ge=2, le=10**6)

    @model_validator(mode="after")
    def _check_bounds(self) -> Self:
        if not self.low < self.high:
            raise ValueError(f"low must be below high, not {self.low:g} and {self.high:g}")
        if self.log and self.low <= 0:
            raise ValueError(f"a log axis needs low > 0, not {self.low:g}")
        if self.log and self.step is not None:
            raise ValueError("a log axis takes no step; drop 'step' or 'log'")
        return self


class ValuesAxis(Section):
    """Search an option over an explicit list; the only kind of axis for bools and enumerations."""

    values: list[AxisValue] = Field(min_length=1)

    @model_validator(mode="after")
    def _check_values(self) -> Self:
        if len({(isinstance(value, bool), value) for value in self.values}) < len(self.values):  # 1 and 1.0 are one
            raise ValueError("values must differ from each other")
        return self


def _kind(axis: object) -> str:
    if isinstance(axis, dict):
        return "values" if "values" in axis else "range"
    return "values" if isinstance(axis, ValuesAxis) else "range"


Axis = Annotated[
    Annotated[RangeAxis, Tag("range")] | Annotated[ValuesAxis, Tag("values")],
    Discriminator(_kind),
]
