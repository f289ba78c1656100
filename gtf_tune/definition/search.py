"""Define the search: its sampler, its budget and its seed."""

import math
import re
from collections.abc import Mapping
from types import MappingProxyType
from typing import Literal, Self

from pydantic import Field, JsonValue, field_validator, model_validator

from gtf_tune.definition.base import Section
from gtf_tune.definition.space import Axis, ValuesAxis
from gtf_tune.errors import did_you_mean

DEFAULT_TRIALS = 50
"""Budget of a search that is not a grid and does not say otherwise."""

SAMPLERS = ("auto", "grid", "refine", "tpe", "qmc", "random")
"""Names of the samplers that gtf-tune brings along."""

FORMER_SAMPLERS = MappingProxyType({"gp": "optuna.samplers:GPSampler", "cmaes": "optuna.samplers:CmaEsSampler"})
"""Names that stored studies may have, with Optuna's samplers that they stood for."""

_CLASS = re.compile(r"[A-Za-z_][\w.]*:[A-Za-z_][\w.]*")


class SearchDefinition(Section):
    """Define the search: sampler, budget in trials (nominal included) and seed.

    ``sampler = "auto"`` becomes what suits the space (see docs/performance.md): a grid for lists of values that the
    budget covers, ``refine`` where there is a range, else ``tpe``. ``module:Class`` is any sampler of Optuna's kind,
    made with ``sampler_arguments``.
    """

    sampler: str = "auto"
    sampler_arguments: dict[str, JsonValue] = Field(default_factory=dict)
    trials: int | None = Field(default=None, ge=1, le=10**7)
    seed: int = Field(default=0, ge=0, lt=2**31)
    pruner: Literal["none", "wilcoxon"] = "none"

    @field_validator("sampler")
    @classmethod
    def _check_sampler(cls, name: str) -> str:
        if name in SAMPLERS or name in FORMER_SAMPLERS or _CLASS.fullmatch(name):
            return name
        hint = did_you_mean(name, SAMPLERS)
        raise ValueError(
            f"should be {', '.join(SAMPLERS)}, or module:Class of an Optuna sampler, not {name!r}"
            + (f"; {hint}" if hint else "")
        )

    @model_validator(mode="after")
    def _check_arguments(self) -> Self:
        if self.sampler_arguments and not self.is_foreign:
            raise ValueError(f"sampler {self.sampler!r} takes no sampler_arguments; only one named module:Class does")
        return self

    @property
    def is_foreign(self) -> bool:
        """Return True if the sampler is named ``module:Class``."""
        return ":" in self.sampler


def suited_sampler(space: Mapping[str, Axis], trials: int | None) -> str:
    """Return the sampler that suits a space and a budget of trials."""
    lists = [axis for axis in space.values() if isinstance(axis, ValuesAxis)]
    size = math.prod(len(axis.values) for axis in lists) + 1
    if len(lists) == len(space) and size <= (trials or DEFAULT_TRIALS):
        return "grid"
    return "refine" if len(lists) < len(space) else "tpe"
