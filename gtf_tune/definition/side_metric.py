"""Define the yardstick beside the search: how runs are measured against ground truth, where there is any."""

from typing import Literal, Self

from pydantic import Field, model_validator

from gtf_tune.definition.base import Section

_ALIGNED = {"sim3": "", "se3": ", SE(3)", "none": ", no alignment"}
_SHORT_UNITS = {"frames": "frames", "seconds": "s", "metres": "m"}


class SideMetricDefinition(Section):
    """Choose the error of the clean runs against ground truth; the search never sees it.

    ``se3`` and ``none`` are for pipelines that know the scale (stereo, RGB-D). ``rpe_delta`` is in ``rpe_delta_unit``
    and only read by the rpe metrics.
    """

    metric: Literal["ate", "rpe_translation", "rpe_rotation"] = "ate"
    alignment: Literal["sim3", "se3", "none"] = "sim3"
    rpe_delta: float = Field(default=1.0, gt=0)
    rpe_delta_unit: Literal["frames", "seconds", "metres"] = "frames"
    rpe_pairs: Literal["all", "consecutive"] = "all"

    @model_validator(mode="after")
    def _check_delta(self) -> Self:
        if self.rpe_delta_unit == "frames" and self.rpe_delta != int(self.rpe_delta):
            raise ValueError(f"rpe_delta should be a whole number of frames, not {self.rpe_delta:g}")
        return self

    @property
    def key(self) -> str:
        """Return the name under which values are exported: ``gt_ate``, ``gt_rpe_translation``, ``gt_rpe_rotation``."""
        return f"gt_{self.metric}"

    @property
    def unit(self) -> str:
        """Return the unit of values, short: degrees, or that of the ground truth, which no data set states."""
        return "deg" if self.metric == "rpe_rotation" else "GT unit"

    @property
    def words(self) -> str:
        """Return what is measured, as in ``RPE over 5 frames, SE(3)``."""
        aligned = _ALIGNED[self.alignment]
        if self.metric == "ate":
            return f"ATE{aligned}"
        name = "rotation RPE" if self.metric == "rpe_rotation" else "RPE"
        unit = _SHORT_UNITS[self.rpe_delta_unit]
        if self.rpe_delta_unit == "frames" and self.rpe_delta == 1:
            unit = "frame"
        pairs = ", consecutive pairs" if self.rpe_pairs == "consecutive" else ""
        return f"{name} over {self.rpe_delta:g} {unit}{pairs}{aligned}"
