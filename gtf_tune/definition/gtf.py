"""How a configuration is scored: runs, noise, metric, aggregate, feasibility."""

from typing import Literal, Self

from pydantic import Field, field_validator, model_validator

from gtf_tune.definition.base import Section

_MAX_GREY = 255


class NoisyRuns(Section):
    """Number of noisy runs that grew from ``min`` to ``max`` in earlier versions; stored studies may name it."""

    min: int = Field(default=3, ge=2)
    max: int = Field(default=12, ge=2)

    @model_validator(mode="after")
    def _check_order(self) -> Self:
        if self.min > self.max:
            raise ValueError(f"min must not exceed max, not {self.min} and {self.max}")
        return self


class GtfDefinition(Section):
    """Score of a trial (paper, section "GTF ATE").

    ``clean_runs`` is k; ``noisy_runs`` is k_delta, few by default, because the noise is common to all trials and a
    confirmation follows (docs/bank.md compares other numbers). ``noise_sigma`` is in grey levels (0..255).
    ``coverage_floor`` is the fraction of nominal coverage that every run must reach. ``common_noise`` gives run j of
    every trial the same noise. ``aggregate`` is the median by default, which ranks best where some runs diverge
    (docs/results-appendix.md); ``mean`` is the paper's. ``rpe_delta`` is in ``rpe_delta_unit`` and only read by the rpe
    metrics.
    """

    clean_runs: int = Field(default=2, ge=1, le=1000)
    noisy_runs: int | NoisyRuns = 3
    noise_sigma: float | Literal["auto"] = "auto"
    metric: Literal["ate", "rpe_translation", "rpe_rotation"] = "ate"
    alignment: Literal["sim3", "se3", "none"] = "sim3"
    aggregate: Literal["mean", "median", "gmean", "trimmed"] = "median"
    normalise: Literal["extent", "none"] = "extent"
    common_noise: bool = True
    coverage_floor: float = Field(default=0.95, ge=0, le=1)
    rpe_delta: float = Field(default=1.0, gt=0)
    rpe_delta_unit: Literal["frames", "seconds", "metres"] = "frames"
    rpe_pairs: Literal["all", "consecutive"] = "all"

    @field_validator("noisy_runs")
    @classmethod
    def _check_noisy_runs(cls, runs: int | NoisyRuns) -> int | NoisyRuns:
        if isinstance(runs, int) and runs < 1:
            raise ValueError(f"should be at least 1, not {runs}")
        return runs

    @field_validator("noise_sigma")
    @classmethod
    def _check_noise_sigma(cls, sigma: float | str) -> float | str:
        if not isinstance(sigma, str) and not 0 < sigma <= _MAX_GREY:
            raise ValueError(f"should lie in (0, 255] grey levels or be 'auto', not {sigma:g}")
        return sigma

    @property
    def noisy_runs_min(self) -> int:
        """Return how many noisy runs every trial has."""
        return self.noisy_runs if isinstance(self.noisy_runs, int) else self.noisy_runs.min

    @property
    def noisy_runs_max(self) -> int:
        """Return how many noisy runs a trial gets."""
        return self.noisy_runs if isinstance(self.noisy_runs, int) else self.noisy_runs.max

    @property
    def noisy_runs_text(self) -> str:
        """Return how many noisy runs the trials of a study have, in words: ``6`` or ``3 to 12``."""
        least, most = self.noisy_runs_min, self.noisy_runs_max
        return str(most) if least == most else f"{least} to {most}"

    @property
    def score_text(self) -> str:
        """Return how a trial is scored, in words; angles are in degrees, whatever the extent is."""
        scale = "" if self.metric == "rpe_rotation" else f", normalised by {self.normalise}"
        return f"{self.metric}, {self.aggregate}, {self.alignment}{scale}"


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
