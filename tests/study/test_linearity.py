"""The true error over the noise is drawn with the line through its first values."""

import math

import numpy as np
import pytest

from gtf_tune.pipelines import analytic
from gtf_tune.report.noise_page import draw_truth
from gtf_tune.study.ground_truth.linearity import TrueErrors, true_errors
from gtf_tune.study.noise.choice import NoiseLevel
from gtf_tune.study.noise.ladder import Line, noise_scale
from gtf_tune.study.runs.run_source import SequenceRuns
from gtf_tune.trajectory import Trajectory

TRUTH = analytic.ground_truth(range(20))
EMPTY = Trajectory(np.empty(0, np.int64), np.empty(0), np.empty((0, 3)), np.empty((0, 4)))


def shaken(error: float) -> SequenceRuns:
    """Return one run whose positions are off by ``error`` times one fixed pattern."""
    pattern = np.random.default_rng(0).normal(size=(20, 3))
    moved = Trajectory(TRUTH.frame_ids, TRUTH.timestamps, TRUTH.positions + error * pattern, TRUTH.quaternions)
    return SequenceRuns((moved,), (), 20)


def test_the_line_goes_through_the_levels_of_the_linear_range() -> None:
    levels = [NoiseLevel(sigma, 0.01 * sigma, 0.1, 4) for sigma in (1.0, 2.0, 3.0)]
    scale = noise_scale(NoiseLevel(0.0, 1e-4, 0.1, 4), [*levels, NoiseLevel(8.0, 0.5, 0.1, 4)])

    found = true_errors(scale, [shaken(0.001 * (1 + sigma)) for sigma in (0, 1, 2, 3, 100)], TRUTH)

    assert found.sigmas == (0.0, 1.0, 2.0, 3.0, 8.0)
    assert found.line.slope == pytest.approx(found.errors[0], rel=0.01)
    assert found.line.r_squared == pytest.approx(1.0, abs=1e-4)


def test_a_level_that_cannot_be_compared_is_left_out() -> None:
    scale = noise_scale(
        NoiseLevel(0.0, 1e-4, 0.1, 4), [NoiseLevel(sigma, 0.01 * sigma, 0.1, 4) for sigma in (1.0, 2.0)]
    )
    lost = SequenceRuns((EMPTY,), (), 20)

    found = true_errors(scale, [shaken(0.001), lost, shaken(0.003)], TRUTH)

    assert math.isnan(found.errors[1])
    assert found.line.slope > 0


def test_the_figure_shows_every_level_and_the_line() -> None:
    dots, line = draw_truth(TrueErrors((0.0, 1.0, 5.0), (1.0, 2.0, math.nan), Line(1.0, 1.0, 0.9))).data

    assert list(dots.y) == [1.0, 2.0, None]
    assert list(line.y) == [1.0, 6.0]
    assert line.name == "first values, R² 0.90"
