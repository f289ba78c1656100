"""A whole study definition: pipeline, sequences, space, score, search and limits."""

import math
import re
from collections.abc import Mapping
from types import MappingProxyType
from typing import Annotated, Any, Literal, Self

from pydantic import AfterValidator, Discriminator, Field, JsonValue, Tag, field_validator, model_validator

from gtf_tune.definition.base import Section
from gtf_tune.definition.gtf import GtfDefinition, SideMetricDefinition
from gtf_tune.errors import did_you_mean

AxisValue = bool | int | float | str


class RangeAxis(Section):
    """Option that is searched between two bounds.

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
    """Option that is searched over an explicit list; the only kind of axis for bools and enumerations."""

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


DEFAULT_TRIALS = 50
"""Default budget of a search that is not a grid."""

SAMPLERS = ("auto", "grid", "refine", "tpe", "qmc", "random")
"""Names of the built-in samplers."""

FORMER_SAMPLERS = MappingProxyType({"gp": "optuna.samplers:GPSampler", "cmaes": "optuna.samplers:CmaEsSampler"})
"""Names in stored studies of samplers that were removed, with the Optuna samplers that they stood for."""

_CLASS = re.compile(r"[A-Za-z_][\w.]*:[A-Za-z_][\w.]*")


class SearchDefinition(Section):
    """Search: sampler, budget in trials (nominal included) and seed.

    ``sampler = "auto"`` becomes what suits the space (see docs/performance.md): a grid for lists of values that the
    budget covers, ``refine`` where there is a range, else ``tpe``. ``module:Class`` is any sampler of Optuna's kind,
    made with ``sampler_arguments``. ``first`` are configurations that are tried right after nominal, besides the
    ``trials``, each as the searched options that differ from nominal. ``baselines`` are what people use beside the
    defaults, options by name: each is one more candidate of a confirmation, and may be adopted.
    """

    sampler: str = "auto"
    sampler_arguments: dict[str, JsonValue] = Field(default_factory=dict)
    trials: int | None = Field(default=None, ge=1, le=10**7)
    seed: int = Field(default=0, ge=0, lt=2**31)
    pruner: Literal["none", "wilcoxon"] = "none"
    first: list[dict[str, AxisValue]] = Field(default_factory=list)
    baselines: dict[str, dict[str, AxisValue]] = Field(default_factory=dict)

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


_NAME = re.compile(r"[A-Za-z0-9][A-Za-z0-9._-]{0,99}")
_NOT_IN_NAMES = re.compile(r"[^A-Za-z0-9._-]+")


def check_name(name: str) -> str:
    """Return the name of a study or a sequence, or raise `ValueError`."""
    if not _NAME.fullmatch(name):
        raise ValueError(f"should be 1 to 100 letters, digits, '.', '_' or '-', not {name!r}")
    return name


Name = Annotated[str, AfterValidator(check_name)]


class PipelineDefinition(Section):
    """Pipeline that is tuned, its options as far as they are known, and settings (``pairing = "sequential"``).

    ``options`` are held fixed. ``nominal`` is the user's baseline: what nominal means for options that are searched,
    and the value in every trial of those that are not. Other options have the program's defaults.
    """

    name: str
    options: dict[str, bool | int | float | str] = Field(default_factory=dict)
    nominal: dict[str, bool | int | float | str] = Field(default_factory=dict)
    settings: dict[str, JsonValue] = Field(default_factory=dict)


class CameraDefinition(Section):
    """Intrinsics given by hand: a COLMAP camera model and its parameters (pixel centres at +0.5)."""

    model: str
    params: list[float]


class SequenceDefinition(Section):
    """Sequence, and the frames of it that are used.

    ``path`` is relative to the definition file. ``camera = "unknown"`` ignores the intrinsics that the data set has.
    ``exclude`` leaves out images whose names or paths fit a glob pattern; ``recursive`` takes those of subfolders too.
    ``holdout`` sequences are only evaluated at confirmation. ``cameras`` says which images share a camera: as the data
    set and the EXIF of photographs say, one for all, one per folder or image; "largest" uses only the images of the
    camera that took most.
    """

    name: Name
    path: str
    layout: str = "auto"
    camera: CameraDefinition | Literal["auto", "unknown"] = "auto"
    start: int | None = Field(default=None, ge=0)
    stop: int | None = Field(default=None, ge=1)
    stride: int | None = Field(default=None, ge=1)
    max_frames: int | None = Field(default=None, ge=2)
    rate_hz: float | None = Field(default=None, gt=0)
    max_image_size: int | None = Field(default=None, ge=16)
    exclude: list[str] = Field(default_factory=list)
    recursive: bool = False
    holdout: bool = False
    cameras: Literal["auto", "one", "per-folder", "per-image", "largest"] = "auto"

    @property
    def selection(self) -> dict[str, Any]:
        """Return the fields that choose frames and their size, as far as they are given."""
        names = ("start", "stop", "stride", "max_frames", "rate_hz", "max_image_size")
        given = {name: getattr(self, name) for name in names}
        given |= {"exclude": tuple(self.exclude) or None, "recursive": self.recursive or None}
        given |= {"cameras": self.cameras if self.cameras != "auto" else None}
        return {name: value for name, value in given.items() if value is not None}


class LimitsDefinition(Section):
    """What one run may take."""

    run_timeout_s: float = Field(default=600.0, gt=0, le=1e9)
    run_memory_gb: float = Field(default=8.0, gt=0, le=1e6)


class StudyDefinition(Section):
    """Study as a user defines it; the whole definition is stored with the study."""

    name: Name
    pipeline: PipelineDefinition
    sequences: list[SequenceDefinition] = Field(min_length=1)
    space: dict[str, Axis] = Field(min_length=1)
    gtf: GtfDefinition = GtfDefinition()
    side_metric: SideMetricDefinition = SideMetricDefinition()
    search: SearchDefinition = SearchDefinition()
    limits: LimitsDefinition = LimitsDefinition()

    @model_validator(mode="after")
    def _check_together(self) -> Self:
        names = [sequence.name for sequence in self.sequences]
        if len(set(names)) < len(names):
            raise ValueError("sequences must have different names")
        if all(sequence.holdout for sequence in self.sequences):
            raise ValueError("at least one sequence must not be a holdout")
        both = sorted(set(self.space) & set(self.pipeline.options))
        if both:
            raise ValueError(f"an option is either fixed or searched, not both: {', '.join(both)}")
        options, nominal = self.pipeline.options, self.pipeline.nominal
        contradicted = sorted(name for name in set(options) & set(nominal) if options[name] != nominal[name])
        if contradicted:
            raise ValueError(f"options held fixed at other values than their nominal ones: {', '.join(contradicted)}")
        return self

    @model_validator(mode="after")
    def _resolve_sampler(self) -> Self:
        if self.search.sampler == "auto":
            resolved = self.search.model_copy(update={"sampler": suited_sampler(self.space, self.search.trials)})
            object.__setattr__(self, "search", resolved)
        return self

    @property
    def searched_sequences(self) -> list[SequenceDefinition]:
        """Return the sequences that are not held out."""
        return [sequence for sequence in self.sequences if not sequence.holdout]

    @property
    def fixed_options(self) -> dict[str, bool | int | float | str]:
        """Return the options with the same value in every trial, as far as they are given."""
        unsearched = {name: value for name, value in self.pipeline.nominal.items() if name not in self.space}
        return {**self.pipeline.options, **unsearched}


def name_from(folder: str) -> str:
    """Return a valid name for a study or a sequence, as close to the name of a folder as possible."""
    return folder if _NAME.fullmatch(folder) else _NOT_IN_NAMES.sub("-", folder).strip("-._")[:100] or "images"
