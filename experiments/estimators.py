"""Measure precision from the same runs in other ways than the paper's, to compare them with it at equal cost."""

import math
from collections.abc import Sequence
from functools import reduce

import numpy as np

from gtf_tune.errors import TrajectoryError
from gtf_tune.gtf.random_effects import far_from_median
from gtf_tune.metrics import pairwise_matrix
from gtf_tune.trajectory import FloatArray, Trajectory
from gtf_tune.trajectory.alignment import MIN_MATCHED, umeyama

_ROUNDS = 5


def between(trajectories: Sequence[Trajectory]) -> float:
    """Return the median error of trajectories against each other, as a share of the extent; NaN where none compares."""
    pairs = pairwise_matrix(trajectories, trajectories)
    errors = (pairs.errors / pairs.extents)[~np.eye(len(trajectories), dtype=bool)]
    known = errors[~np.isnan(errors)]
    return float(np.median(known)) if known.size else math.nan


def dispersion(trajectories: Sequence[Trajectory]) -> float:
    """Return how far trajectories lie from their consensus: the median RMSE as a share of the extent.

    The consensus is the pointwise median of all trajectories after Sim(3) alignment with it, over the frames that all
    share (generalised Procrustes analysis; Gower, Psychometrika 40, 1975). NaN where they share fewer than four frames
    or cannot be aligned.
    """
    frames = reduce(np.intersect1d, (trajectory.frame_ids for trajectory in trajectories))
    if len(frames) < MIN_MATCHED:
        return math.nan
    points = [trajectory.positions[np.isin(trajectory.frame_ids, frames)] for trajectory in trajectories]
    consensus = points[0]
    try:
        for _ in range(_ROUNDS):
            aligned = [umeyama(point, consensus).apply(point) for point in points]
            consensus = np.median(aligned, axis=0)
    except TrajectoryError:
        return math.nan
    errors = [math.sqrt(((one - consensus) ** 2).sum(axis=1).mean()) for one in aligned]
    extent = math.sqrt(((consensus - consensus.mean(axis=0)) ** 2).sum(axis=1).mean())
    return float(np.median(errors)) / extent


def paired_ratio(nominal: FloatArray, matrix: FloatArray) -> float:
    """Return the geometric mean of a setting's errors over nominal's, instance by instance, without far ones.

    This is what confirmation tests. Both are (k, k_delta) matrices; pairs that failed in either are left out.
    """
    count = min(nominal.shape[1], matrix.shape[1])
    if len(nominal) != len(matrix) or not count:
        return math.nan
    with np.errstate(invalid="ignore", divide="ignore"):
        logs = (np.log(matrix[:, :count]) - np.log(nominal[:, :count])).mean(axis=0)
    logs = np.where(np.isfinite(logs), logs, np.nan)
    kept = logs[~np.isnan(logs) & ~far_from_median(logs)]
    return float(np.exp(kept.mean())) if kept.size else math.nan
