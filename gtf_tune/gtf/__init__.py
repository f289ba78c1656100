"""The ground-truth-free score of a configuration: how much noisy runs differ from clean ones."""

from gtf_tune.gtf.aggregate import (
    Aggregate,
    Estimate,
    aggregate_instances,
    aggregate_matrix,
    common_collapses,
    estimate,
    find_collapsed,
)
from gtf_tune.gtf.comparison import PairedDifference, difference_over_sequences, holm, paired_difference
from gtf_tune.gtf.score import GtfMetric, GtfScore, GtfSettings, Normalise, gtf_score, score_of_pairs

__all__ = [
    "Aggregate",
    "Estimate",
    "GtfMetric",
    "GtfScore",
    "GtfSettings",
    "Normalise",
    "PairedDifference",
    "aggregate_instances",
    "aggregate_matrix",
    "common_collapses",
    "difference_over_sequences",
    "estimate",
    "find_collapsed",
    "gtf_score",
    "holm",
    "paired_difference",
    "score_of_pairs",
]
