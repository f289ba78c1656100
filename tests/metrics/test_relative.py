import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from gtf_tune.errors import DefinitionError, TrajectoryError
from gtf_tune.metrics import RpeSettings, rpe, rpe_errors, summarise
from gtf_tune.metrics.relative import pose_pairs
from gtf_tune.trajectory import Trajectory

LINE = np.zeros((11, 3))
LINE[:, 0] = np.arange(11.0)


def pairs(times, positions=LINE, **chosen) -> list[tuple[int, int]]:
    first, second = pose_pairs(np.asarray(times, dtype=float), positions, RpeSettings(**chosen))
    return list(zip(first.tolist(), second.tolist(), strict=True))


def spiral(count: int = 60, rate: float = 0.0) -> Trajectory:
    angle = np.linspace(0, 6, count)
    turns = Rotation.from_rotvec(np.outer(angle * (1 + rate), [0, 0, 1]))
    positions = np.column_stack([np.cos(angle), np.sin(angle), 0.2 * angle])
    return Trajectory(np.arange(count), np.arange(count) / 10, positions, turns.as_quat())


def test_frames_count_poses():
    assert pairs(np.arange(6), delta=2) == [(0, 2), (1, 3), (2, 4), (3, 5)]
    assert pairs(np.arange(6), delta=2, pairs="consecutive") == [(0, 2), (2, 4)]
    assert pairs(np.arange(2), delta=2) == []


def test_seconds_follow_the_clock():
    times = [0, 0.5, 1.0, 1.1, 2.0, 2.1]

    assert pairs(times, delta=1.0, delta_unit="seconds") == [(0, 2), (2, 4), (3, 5)]
    assert pairs(times, delta=1.0, delta_unit="seconds", pairs="consecutive") == [(0, 2), (2, 4)]


def test_a_round_delta_is_reached_by_steps_that_do_not_sum_exactly():
    times = np.cumsum(np.full(11, 0.1))

    assert pairs(times, delta=0.5, delta_unit="seconds", pairs="consecutive") == [(0, 5), (5, 10)]


def test_metres_follow_the_path():
    assert pairs(np.arange(11), delta=4.0, delta_unit="metres", pairs="consecutive") == [(0, 4), (4, 8)]
    assert pairs(np.arange(11), delta=9.0, delta_unit="metres") == [(0, 9), (0 + 1, 10)]


def test_a_camera_that_stands_still_ends():
    still = np.zeros((5, 3))

    assert pairs(np.arange(5), still, delta=1.0, delta_unit="metres") == []
    assert pairs(np.arange(5), still, delta=1.0, delta_unit="metres", pairs="consecutive") == []
    assert pairs(np.full(5, 1e9), delta=1e-30, delta_unit="seconds", pairs="consecutive") == [
        (0, 1),
        (1, 2),
        (2, 3),
        (3, 4),
    ]


@given(st.lists(st.floats(0.01, 3.0), min_size=2, max_size=40), st.floats(0.1, 5.0))
def test_all_pairs_along_the_clock_are_the_nearest(steps, delta):
    times = np.cumsum(steps)
    tolerance = 0.1 * delta

    found = dict(pairs(times, delta=delta, delta_unit="seconds"))

    for start in range(len(times) - 1):
        misses = np.abs(times[start + 1 :] - times[start] - delta)
        if misses.min() < tolerance * (1 - 1e-9):
            assert misses[found[start] - start - 1] == pytest.approx(misses.min(), abs=1e-12)
        elif misses.min() > tolerance * (1 + 1e-9):
            assert start not in found


def test_drift_in_rotation_is_measured_in_degrees():
    per_step_deg = np.degrees(6 / 59)

    error = rpe(spiral(), spiral(rate=0.01), RpeSettings("rotation", alignment="none"))

    assert error == pytest.approx(0.01 * per_step_deg, rel=1e-9)


def test_tiny_rotations_keep_their_digits():
    a = spiral()
    tilt = Rotation.from_rotvec(np.outer(np.arange(60) % 2, [1e-10, 0, 0]))
    b = Trajectory(a.frame_ids, a.timestamps, a.positions, (a.rotations * tilt).as_quat())

    assert rpe(a, b, RpeSettings("rotation")) == pytest.approx(np.degrees(1e-10), rel=1e-5)


@pytest.mark.parametrize("relation", ["translation", "rotation"])
def test_a_quaternion_and_its_negative_are_the_same_rotation(relation):
    a, b = spiral(), spiral(rate=0.02)
    signs = np.where(np.arange(60) % 3 == 0, -1.0, 1.0)[:, np.newaxis]
    flipped = Trajectory(b.frame_ids, b.timestamps, b.positions, signs * b.quaternions)

    chosen = RpeSettings(relation)

    np.testing.assert_allclose(rpe_errors(a, flipped, chosen), rpe_errors(a, b, chosen), rtol=1e-12, atol=1e-14)


@given(st.integers(0, 2**32 - 1), st.sampled_from(["translation", "rotation"]))
def test_relative_errors_ignore_the_world_frame(seed, relation):
    rng = np.random.default_rng(seed)
    a, b = spiral(), spiral(rate=0.02)
    moved = b.transformed(3.0, Rotation.random(random_state=rng).as_matrix(), rng.normal(size=3))

    chosen = RpeSettings(relation, delta=3)

    np.testing.assert_allclose(rpe_errors(a, moved, chosen), rpe_errors(a, b, chosen), rtol=1e-8, atol=1e-12)


def test_without_a_pair_the_reason_is_given():
    with pytest.raises(TrajectoryError, match="1000 seconds apart"):
        rpe(spiral(), spiral(), RpeSettings(delta=1000, delta_unit="seconds"))


@pytest.mark.parametrize("delta", [0, -1, np.nan, np.inf])
def test_delta_must_be_positive(delta):
    with pytest.raises(DefinitionError, match="positive delta"):
        RpeSettings(delta=delta, delta_unit="metres")


def test_delta_in_frames_must_be_whole():
    with pytest.raises(DefinitionError, match="whole number of frames"):
        RpeSettings(delta=1.5)


@pytest.mark.parametrize("word", ["relation", "delta_unit", "pairs", "alignment"])
def test_unknown_words_are_refused_with_the_known_ones(word):
    with pytest.raises(DefinitionError, match=r"one of .*, not 'other'"):
        RpeSettings(**{word: "other"})


def test_statistics_are_the_usual_ones():
    found = summarise(np.array([1.0, 2.0, 3.0, 6.0]))

    assert (found.mean, found.median, found.min, found.max, found.count) == (3.0, 2.5, 1.0, 6.0, 4)
    assert found.rmse == pytest.approx(np.sqrt(12.5))
    assert found.std == pytest.approx(np.sqrt(3.5))
    with pytest.raises(TrajectoryError, match="at least one error"):
        summarise(np.empty(0))
