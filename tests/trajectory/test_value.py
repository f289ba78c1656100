import pickle

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from gtf_tune.errors import TrajectoryError
from gtf_tune.trajectory import Trajectory, from_bytes, to_bytes


def trajectory_of(count: int, seed: int = 0, names: bool = False) -> Trajectory:
    rng = np.random.default_rng(seed)
    return Trajectory(
        frame_ids=np.cumsum(rng.integers(1, 4, count)),
        timestamps=np.cumsum(rng.uniform(0.01, 1.0, count)),
        positions=rng.normal(size=(count, 3)).cumsum(axis=0),
        quaternions=rng.normal(size=(count, 4)),
        names=tuple(f"früh/{index:06d}.png" for index in range(count)) if names else (),
    )


def assert_same_bits(a: Trajectory, b: Trajectory) -> None:
    for name in ("frame_ids", "timestamps", "positions", "quaternions"):
        assert getattr(a, name).tobytes() == getattr(b, name).tobytes()
    assert a.names == b.names


def test_quaternions_are_normalised():
    trajectory = trajectory_of(20)

    np.testing.assert_allclose(np.linalg.norm(trajectory.quaternions, axis=1), 1, rtol=1e-15)


def test_arrays_are_copies_that_nobody_can_change():
    positions = np.zeros((1, 3))
    trajectory = Trajectory(np.array([0]), np.array([0.0]), positions, np.array([[0.0, 0, 0, 1]]))

    positions[0, 0] = 5

    assert trajectory.positions[0, 0] == 0
    with pytest.raises(ValueError, match="read-only"):
        trajectory.positions[0, 0] = 1


@pytest.mark.parametrize(
    ("field", "value", "reason"),
    [
        ("frame_ids", np.array([1, 1]), "strictly increasing frame ids, but 1 follows 1 at pose 1"),
        ("frame_ids", np.array([2, 1]), "strictly increasing"),
        ("frame_ids", np.array([0.5, 1.5]), "whole frame ids"),
        ("timestamps", np.array([0.0, np.inf]), "finite timestamps, but pose 1"),
        ("timestamps", np.array([0.0]), "timestamps of shape"),
        ("positions", np.array([[0.0, 0, 0], [0, np.nan, 0]]), "finite positions, but pose 1"),
        ("positions", np.zeros((2, 2)), "positions of shape"),
        ("quaternions", np.array([[0.0, 0, 0, 1], [0, 0, 0, 0]]), "unit quaternions, but pose 1"),
        ("quaternions", np.array([[0.0, 0, 0, 1], [0, 0, 0, 1e200]]), "unit quaternions, but pose 1"),
        ("names", ("a.png",), "one name for each of 2 poses, not 1"),
        ("names", ("a.png", "b\0.png"), "zero bytes"),
    ],
)
def test_faulty_arrays_are_refused_with_the_reason(field, value, reason):
    good = {
        "frame_ids": np.array([0, 1]),
        "timestamps": np.array([0.0, 1.0]),
        "positions": np.zeros((2, 3)),
        "quaternions": np.array([[0.0, 0, 0, 1], [0, 0, 0, 1]]),
        "names": (),
    }

    with pytest.raises(TrajectoryError, match=reason):
        Trajectory(**{**good, field: value})


def test_empty_trajectory_has_no_poses():
    assert len(Trajectory.empty()) == 0
    assert len(Trajectory.empty().transformed(2.0, np.eye(3), np.ones(3))) == 0


def test_select_takes_masks_and_indices():
    trajectory = trajectory_of(6, names=True)

    by_mask = trajectory.select(np.array([True, False, True, False, False, True]))
    by_index = trajectory.select(np.array([0, 2, 5]))

    assert_same_bits(by_mask, by_index)
    assert by_mask.names == (trajectory.names[0], trajectory.names[2], trajectory.names[5])


def test_transformed_moves_centres_and_turns_cameras():
    trajectory = trajectory_of(10)
    turn = Rotation.from_euler("z", 90, degrees=True)

    moved = trajectory.transformed(2.0, turn.as_matrix(), np.array([1.0, 2, 3]))

    np.testing.assert_allclose(moved.positions, 2 * trajectory.positions @ turn.as_matrix().T + [1, 2, 3])
    # A point one unit before the camera stays before it.
    ahead = trajectory.positions + trajectory.rotations.apply([0, 0, 1])
    np.testing.assert_allclose(
        moved.positions + 2 * moved.rotations.apply([0, 0, 1]), 2 * turn.apply(ahead) + [1, 2, 3]
    )


@given(st.integers(0, 50), st.integers(0, 2**32 - 1), st.booleans())
def test_bytes_keep_every_bit(count, seed, names):
    trajectory = trajectory_of(count, seed, names)

    assert_same_bits(from_bytes(to_bytes(trajectory)), trajectory)


def test_copying_and_pickling_keep_every_bit():
    trajectory = trajectory_of(30, names=True)

    assert_same_bits(pickle.loads(pickle.dumps(trajectory)), trajectory)
    assert_same_bits(trajectory.select(np.arange(30)), trajectory)


def test_bytes_are_smaller_than_the_numbers():
    assert len(to_bytes(trajectory_of(2000))) < 0.8 * 2000 * 9 * 8


@given(st.data())
def test_any_flipped_bit_is_noticed(data):
    stored = bytearray(to_bytes(trajectory_of(5, names=True)))
    position = data.draw(st.integers(0, len(stored) - 1))
    stored[position] ^= 1 << data.draw(st.integers(0, 7))

    with pytest.raises(TrajectoryError):
        from_bytes(bytes(stored))


@given(st.binary(max_size=200))
def test_foreign_bytes_are_refused(data):
    for prefix in (b"", b"GTFT\x01"):
        with pytest.raises(TrajectoryError):
            from_bytes(prefix + data)


def test_truncated_bytes_are_refused():
    stored = to_bytes(trajectory_of(5))

    for length in range(len(stored)):
        with pytest.raises(TrajectoryError):
            from_bytes(stored[:length])


def test_bytes_of_a_newer_version_say_so():
    stored = bytearray(to_bytes(trajectory_of(5)))
    stored[4] = 9

    with pytest.raises(TrajectoryError, match="version 1, not 9"):
        from_bytes(bytes(stored))
