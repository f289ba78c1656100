"""The true error over the noise (the paper's figure on linearity), beside a ladder that knows no ground truth."""

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from gtf_tune.errors import TrajectoryError
from gtf_tune.pipelines.run import RunRequest
from gtf_tune.study.ground_truth.record import side_metric
from gtf_tune.study.noise.choice import ObtainRuns
from gtf_tune.study.noise.ladder import Line, NoiseScale, fit_line
from gtf_tune.study.runs.run_source import SequenceRuns
from gtf_tune.trajectory import Trajectory

FIRST_LEVELS = 3
"""Levels, that without noise among them, that the line goes through at the least."""


@dataclass(frozen=True)
class TrueErrors:
    """Mean ATE against ground truth of the runs of each level, those without noise first; NaN where it is unknown.

    ``sigmas`` are in grey levels, ``errors`` in the unit of the ground truth. ``line`` is fitted through the levels up
    to the end of the linear range of the score.
    """

    sigmas: tuple[float, ...]
    errors: tuple[float, ...]
    line: Line


def recorded(obtain: ObtainRuns, seen: list[SequenceRuns]) -> ObtainRuns:
    """Return a way to obtain runs that also appends them to ``seen``, a level at each call."""

    def obtain_and_note(requests: Sequence[RunRequest]) -> SequenceRuns:
        seen.append(obtain(requests))
        return seen[-1]

    return obtain_and_note


def true_errors(scale: NoiseScale, seen: Sequence[SequenceRuns], ground_truth: Trajectory) -> TrueErrors:
    """Return the true errors of the levels of a ladder; ``seen`` are its runs, those without noise first."""
    sigmas = (0.0, *(level.sigma for level in scale.levels))
    errors = tuple(_mean_error(ground_truth, runs) for runs in seen)
    linear = [place for place, inside in enumerate(scale.linear, start=1) if inside]
    end = max([FIRST_LEVELS, *(place + 1 for place in linear)])
    known = [(sigma, error) for sigma, error in list(zip(sigmas, errors, strict=True))[:end] if math.isfinite(error)]
    x, y = (np.array([both[place] for both in known], dtype=np.float64) for place in (0, 1))
    return TrueErrors(sigmas, errors, fit_line(x, y))


def _mean_error(ground_truth: Trajectory, runs: SequenceRuns) -> float:
    try:
        return side_metric(ground_truth, [*runs.clean, *runs.noisy]).value
    except TrajectoryError:
        return math.nan
