import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from gtf_tune.errors import TrajectoryError
from gtf_tune.trajectory import (
    Trajectory,
    associate_by_frame_id,
    associate_by_name,
    associate_by_timestamp,
    matched,
)


def at(times: list[float], ids: list[int] | None = None, names: tuple[str, ...] = ()) -> Trajectory:
    count = len(times)
    frame_ids = np.arange(count) if ids is None else np.array(ids, dtype=np.int64)
    positions = np.arange(3.0 * count).reshape(count, 3)
    return Trajectory(frame_ids, np.array(times, dtype=float), positions, np.tile([0.0, 0, 0, 1], (count, 1)), names)


def test_frame_ids_match_where_both_have_them():
    ia, ib = associate_by_frame_id(at([0, 1, 2], ids=[0, 4, 9]), at([0, 1, 2, 3], ids=[4, 5, 9, 11]))

    assert ia.tolist() == [1, 2]
    assert ib.tolist() == [0, 2]


def test_nothing_in_common_gives_no_matches():
    for pair in ((at([0.0]), at([1.0], ids=[5])), (at([]), at([1.0])), (at([]), at([]))):
        assert len(associate_by_frame_id(*pair)[0]) == 0
        assert len(associate_by_timestamp(*pair)[0]) == 0


def test_timestamps_match_within_the_tolerance():
    ia, ib = associate_by_timestamp(at([0.0, 1.0, 2.0]), at([0.015, 1.5, 1.99]))

    assert ia.tolist() == [0, 2]
    assert ib.tolist() == [0, 2]


def test_a_pose_is_used_once():
    ia, ib = associate_by_timestamp(at([0.0, 0.01]), at([0.009]))

    assert ia.tolist() == [1]
    assert ib.tolist() == [0]


def test_offset_is_added_to_the_second_trajectory():
    ia, _ = associate_by_timestamp(at([10.0, 11.0]), at([0.0, 1.0]), offset_s=10.0)

    assert ia.tolist() == [0, 1]


def test_duplicate_timestamps_are_refused_with_the_pose():
    with pytest.raises(TrajectoryError, match="second trajectory pose 2"):
        associate_by_timestamp(at([0, 1]), at([0, 1, 1]))


@given(
    st.lists(st.integers(0, 400), unique=True, max_size=30).map(sorted),
    st.lists(st.integers(0, 400), unique=True, max_size=30).map(sorted),
    st.integers(0, 20),
)
def test_timestamp_matches_are_mutual_nearest_neighbours(first, second, limit):
    a, b = at([float(t) for t in first]), at([float(t) for t in second])

    ia, ib = associate_by_timestamp(a, b, max_difference_s=limit)

    gaps = np.abs(a.timestamps[ia] - b.timestamps[ib])
    assert (gaps <= limit).all()
    assert (np.diff(ia) > 0).all()
    assert (np.diff(ib) > 0).all()
    for i, j, gap in zip(ia, ib, gaps, strict=True):
        assert gap == np.abs(b.timestamps - a.timestamps[i]).min()
        assert gap == np.abs(a.timestamps - b.timestamps[j]).min()


def test_names_match_where_both_have_them():
    ia, ib = associate_by_name(
        at([0, 1, 2], names=("a.png", "b.png", "d.png")), at([0, 1, 2], names=("b.png", "c.png", "d.png"))
    )

    assert ia.tolist() == [1, 2]
    assert ib.tolist() == [0, 2]


@pytest.mark.parametrize(
    ("names", "reason"),
    [((), "second trajectory has none"), (("a", "a"), "one of them twice"), (("b", "a"), "in the same order")],
)
def test_unusable_names_are_refused_with_the_reason(names, reason):
    with pytest.raises(TrajectoryError, match=reason):
        associate_by_name(at([0, 1], names=("a", "b")), at([0, 1], names=names))


def test_matched_trajectories_share_frame_ids():
    a, b = at([0, 1, 2], ids=[3, 5, 7]), at([0.0, 2.0], ids=[0, 1])

    cut_a, cut_b = matched(a, b, associate_by_timestamp(a, b))

    assert cut_a.frame_ids.tolist() == cut_b.frame_ids.tolist() == [3, 7]
    np.testing.assert_array_equal(cut_b.positions, b.positions)
