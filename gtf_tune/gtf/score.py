"""The ground-truth-free score of one configuration."""

import math
from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Literal, get_args

import numpy as np

from gtf_tune.gtf.aggregate import Aggregate, aggregate_instances, estimate, find_collapsed
from gtf_tune.metrics import (
    AteSettings,
    DeltaUnit,
    MetricSettings,
    PairMatrix,
    PosePairs,
    RpeRelation,
    RpeSettings,
    check_word,
    pairwise_matrix,
)
from gtf_tune.trajectory import BoolArray, FloatArray, IntArray, Trajectory
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


@dataclass(frozen=True, eq=False)
class GtfScore:
    """Score of one configuration, with everything it was made from.

    Attributes
    ----------
    value
        The aggregate over all pairs that could be measured; smaller is more precise. NaN when none could. Whoever
        minimises it has to look at the coverage and at ``pair_errors`` too: trajectories that cannot be compared have
        no error.
    standard_error, confidence_interval
        Of ``value``, in its unit; 95 %, see `gtf_tune.gtf.aggregate`. NaN where not estimable.
    matrix
        (k, k_delta) error of noisy run j against clean run i, in the unit that the settings say; NaN where it failed.
    pair_errors
        Why pair (i, j) failed.
    coverage_clean, coverage_noisy
        (k,) and (k_delta,): registered frames / frames of the sequence.
    extents
        (k, k_delta): RMS distance of clean positions, at the frames matched in the pair, from their mean. NaN where the
        pair failed.
    matched
        (k, k_delta): number of matched frames.
    num_frames
        Frames of the sequence.
    collapsed
        (k_delta,): noisy runs whose reconstruction fell apart, see `find_collapsed`.
    """

    value: float
    standard_error: float
    confidence_interval: tuple[float, float]
    matrix: FloatArray
    pair_errors: dict[tuple[int, int], str]
    coverage_clean: FloatArray
    coverage_noisy: FloatArray
    extents: FloatArray
    matched: IntArray
    num_frames: int
    collapsed: BoolArray
    settings: GtfSettings = field(default_factory=GtfSettings)

    @property
    def extent(self) -> float:
        """Return the mean extent of the pairs, in the unit of the clean trajectories; NaN when no pair was measured."""
        known = self.extents[~np.isnan(self.extents)]
        return float(known.mean()) if known.size else float("nan")

    @property
    def shorter(self) -> IntArray:
        """Return the frames that the shorter run of each pair registered, (k, k_delta)."""
        frames = self.num_frames * np.minimum.outer(self.coverage_clean, self.coverage_noisy)
        return np.asarray(np.rint(frames), dtype=np.int64)

    @property
    def common_shares(self) -> FloatArray:
        """Return matched frames as a share of those of the shorter run, (k, k_delta); 0 where a run has none."""
        return self.matched / np.maximum(self.shorter, 1)

    @property
    def collapse_rate(self) -> float:
        """Return the share of noisy runs that collapsed, NaN when there are none."""
        return float(self.collapsed.mean()) if self.collapsed.size else float("nan")

    @property
    def instance_values(self) -> FloatArray:
        """Return the score of each noise instance, (k_delta,): the aggregate over the clean runs."""
        return aggregate_instances(self.matrix, self.settings.aggregate)


def gtf_score(
    clean: Sequence[Trajectory], noisy: Sequence[Trajectory], settings: GtfSettings, num_frames: int
) -> GtfScore:
    """Return how much trajectories move under image noise (paper, eq. "metric").

    Parameters
    ----------
    clean, noisy
        k trajectories from clean images and k_delta from noisy ones; those of failed runs are empty.
    num_frames
        Number of frames of the sequence, for the coverage.

    Raises
    ------
    TrajectoryError
        Frame ids only count the poses of a file, and the trajectories have different ones.
    """
    pairs = pairwise_matrix(clean, noisy, settings.pair_metric)
    return score_of_pairs(pairs, settings, [len(run) for run in clean], [len(run) for run in noisy], num_frames)


def score_of_pairs(
    pairs: PairMatrix, settings: GtfSettings, clean: Sequence[int], noisy: Sequence[int], num_frames: int
) -> GtfScore:
    """Return the score of pairs whose errors are known (paper, eq. "metric").

    Parameters
    ----------
    pairs
        (k, k_delta) errors of the noisy against the clean runs, by ``settings.pair_metric``.
    clean, noisy
        Registered frames of the k clean and the k_delta noisy runs.
    num_frames
        Number of frames of the sequence, for the coverage.
    """
    matrix = _in_unit(pairs, settings)
    found = estimate(matrix, settings.aggregate, np.random.default_rng(settings.bootstrap_seed))
    return GtfScore(
        value=found.value,
        standard_error=found.standard_error,
        confidence_interval=(found.low, found.high),
        matrix=matrix,
        pair_errors=pairs.reasons,
        coverage_clean=_coverage(clean, num_frames),
        coverage_noisy=_coverage(noisy, num_frames),
        extents=pairs.extents,
        matched=pairs.matched,
        num_frames=num_frames,
        collapsed=find_collapsed(matrix),
        settings=settings,
    )


def _in_unit(pairs: PairMatrix, settings: GtfSettings) -> FloatArray:
    """Divide by the clean trajectory's extent over the frames of the very pair, which bounds a Sim(3) ATE by 1.

    The residual is smallest over all scales, and scale 0 leaves exactly that extent.
    """
    return pairs.errors / pairs.extents if settings.is_relative else pairs.errors


def _coverage(registered: Sequence[int], num_frames: int) -> FloatArray:
    return np.array([frames / num_frames for frames in registered], dtype=np.float64)
