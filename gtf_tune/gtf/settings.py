"""How the ground-truth-free score is formed."""

import math
from dataclasses import dataclass
from typing import Literal, get_args

from gtf_tune.gtf.aggregate import Aggregate
from gtf_tune.metrics import AteSettings, DeltaUnit, MetricSettings, PosePairs, RpeRelation, RpeSettings, check_word
from gtf_tune.trajectory.alignment import ALIGNMENTS, AlignmentKind

GtfMetric = Literal["ate", "rpe_translation", "rpe_rotation"]
Normalise = Literal["extent", "none"]

_HALF_TURN_DEG = 180.0


@dataclass(frozen=True)
class GtfSettings:
    """Metric of a pair, its unit, and how the matrix of pairs becomes one number.

    Attributes
    ----------
    metric, alignment
        Error of one noisy trajectory against one clean one.
    aggregate
        ``mean`` is the paper's (eq. "metric"); ``median``, ``gmean`` and ``trimmed`` resist a single collapsed run.
    normalise
        ``extent`` divides each error of pair (i, j) by the RMS distance of clean trajectory i's positions, at the
        frames matched with j, from their mean. A Sim(3)-aligned ATE then lies in [0, 1]. ``none`` is the paper's.
        Rotation errors are never divided.
    rpe_delta, rpe_delta_unit, rpe_pairs
        Read by the rpe metrics only; see `gtf_tune.metrics.RpeSettings`.
    bootstrap_seed
        Seed of the resamples behind the interval of ``median`` and ``trimmed``.

    Raises
    ------
    DefinitionError
        A word is unknown.
    """

    metric: GtfMetric = "ate"
    alignment: AlignmentKind = "sim3"
    aggregate: Aggregate = "mean"
    normalise: Normalise = "extent"
    rpe_delta: float = 1.0
    rpe_delta_unit: DeltaUnit = "frames"
    rpe_pairs: PosePairs = "all"
    bootstrap_seed: int = 0

    def __post_init__(self) -> None:
        check_word("metric", self.metric, get_args(GtfMetric))
        check_word("alignment", self.alignment, ALIGNMENTS)
        check_word("aggregate", self.aggregate, get_args(Aggregate))
        check_word("normalise", self.normalise, get_args(Normalise))

    @property
    def pair_metric(self) -> MetricSettings:
        """Return the metric of one pair."""
        if self.metric == "ate":
            return AteSettings(self.alignment)
        relation: RpeRelation = "rotation" if self.metric == "rpe_rotation" else "translation"
        return RpeSettings(relation, self.rpe_delta, self.rpe_delta_unit, self.rpe_pairs, self.alignment)

    @property
    def is_relative(self) -> bool:
        """Whether scores are fractions of the extent."""
        return self.normalise == "extent" and self.metric != "rpe_rotation"

    @property
    def upper_bound(self) -> float:
        """Return the largest possible score: 1 for a relative Sim(3) ATE, 180 (degrees) for rotations, else inf."""
        if self.metric == "rpe_rotation":
            return _HALF_TURN_DEG
        return 1.0 if self.metric == "ate" and self.alignment == "sim3" and self.is_relative else math.inf
