"""A configuration that reconstructs something else than nominal contradicts it."""

import numpy as np
import pytest

from gtf_tune.study.outcome.contradiction import CleanRun, contradictions
from gtf_tune.trajectory import FloatArray, Trajectory

FRAMES = 40
ANGLES = np.linspace(0.0, 4.0, FRAMES)
WALK = np.stack([np.cos(ANGLES), np.sin(ANGLES), 0.2 * ANGLES], axis=1)


def run(positions: FloatArray, points: float = 900.0, tracks: float = 5.0) -> CleanRun:
    count = len(positions)
    times = np.arange(count, dtype=np.float64)
    return CleanRun(
        Trajectory(np.arange(count), times, positions, np.tile([0.0, 0.0, 0.0, 1.0], (count, 1))), points, tracks
    )


def shaken(size: float) -> FloatArray:
    return WALK + size * np.random.default_rng(0).standard_normal(WALK.shape)


TWO_POINTS = np.where(np.arange(FRAMES)[:, None] % 20 < 10, WALK[:1], WALK[-1:])
BLURRED = TWO_POINTS + 0.05 * (shaken(1.0) - WALK)


@pytest.mark.parametrize(
    ("other", "sentence"),
    [
        (run(WALK[:30]), "registers 30 frames where nominal registers 40"),
        (run(WALK, points=400), "keeps 400 points where nominal has 900"),
        (run(WALK, tracks=2.1), "sees a point in 2.1 images where nominal does in 5.0"),
        (run(shaken(0.3)), "has a path of"),
        (run(TWO_POINTS), "gives a trajectory that cannot be compared with nominal's: "),
        (run(BLURRED), "per mille of the extent from nominal's, more than the 50 that noise explains"),
    ],
)
def test_what_was_lost_or_became_another_shape_is_said(other: CleanRun, sentence: str) -> None:
    found = contradictions([run(WALK)], [other], explained=0.001)

    assert any(sentence in one for one in found), found


def test_the_same_shape_at_another_scale_and_place_contradicts_nothing() -> None:
    assert contradictions([run(WALK)], [run(7.0 * shaken(0.002) + 3.0, points=700)], explained=0.001) == ()


def test_what_noise_explains_is_no_other_shape() -> None:
    nominal, other = [run(WALK)], [run(WALK * [1.0, 1.3, 1.0])]

    assert contradictions(nominal, other, explained=0.001)
    assert contradictions(nominal, other, explained=0.09) == ()


def test_one_agreeing_pair_of_clean_runs_is_enough() -> None:
    assert contradictions([run(WALK), run(WALK)], [run(TWO_POINTS), run(WALK)], explained=0.0) == ()


def test_runs_that_failed_are_not_compared() -> None:
    assert contradictions([], [run(WALK)], explained=0.0) == ()
