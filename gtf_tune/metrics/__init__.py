"""Errors between trajectories."""

from gtf_tune.metrics.pairwise import (
    PairMatrix,
    align,
    aligned_errors,
    associated_matrix,
    ate,
    pairwise_matrix,
    rpe,
    rpe_errors,
)
from gtf_tune.metrics.settings import (
    AteSettings,
    DeltaUnit,
    MetricSettings,
    PosePairs,
    RpeRelation,
    RpeSettings,
    check_word,
)
from gtf_tune.metrics.statistics import ErrorStatistics, summarise

__all__ = [
    "AteSettings",
    "DeltaUnit",
    "ErrorStatistics",
    "MetricSettings",
    "PairMatrix",
    "PosePairs",
    "RpeRelation",
    "RpeSettings",
    "align",
    "aligned_errors",
    "associated_matrix",
    "ate",
    "check_word",
    "pairwise_matrix",
    "rpe",
    "rpe_errors",
    "summarise",
]
