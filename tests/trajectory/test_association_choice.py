"""By what the poses of several trajectories are associated."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from gtf_tune.errors import TrajectoryError
from gtf_tune.trajectory import Trajectory, associate, association_of, read_trajectory, write_kitti, write_tum


def poses(count: int) -> Trajectory:
    positions = np.random.default_rng(0).normal(size=(count, 3))
    return Trajectory(np.arange(count), np.arange(count) / 10, positions, np.tile([0.0, 0.0, 0.0, 1.0], (count, 1)))


def kitti(count: int, path: Path) -> Trajectory:
    write_kitti(poses(count), path)
    return read_trajectory(path)


def tum(count: int, path: Path) -> Trajectory:
    write_tum(poses(count), path)
    return read_trajectory(path)


def model(names: list[str], folder: Path) -> Trajectory:
    folder.mkdir()
    (folder / "images.txt").write_text("".join(f"1 1 0 0 0 {n} 0 {n * n} 1 {name}\n\n" for n, name in enumerate(names)))
    return read_trajectory(folder)


def test_models_are_associated_by_name(tmp_path: Path) -> None:
    full = model(["a.png", "b.png", "c.png"], tmp_path / "full")
    cut = model(["a.png", "c.png"], tmp_path / "cut")

    assert association_of([full, cut]) == "name"
    assert [found.tolist() for found in associate(full, cut, "name")] == [[0, 2], [0, 1]]


def test_files_with_times_are_associated_by_time(tmp_path: Path) -> None:
    full, cut = tum(6, tmp_path / "full"), replace(tum(6, tmp_path / "cut"), names=()).select(np.arange(6) != 2)

    assert association_of([full, cut, Trajectory.empty()]) == "timestamp"
    assert associate(full, cut, "timestamp")[0].tolist() == [0, 1, 3, 4, 5]


def test_times_farther_apart_than_evo_allows_do_not_belong_together() -> None:
    later = replace(poses(3), timestamps=np.arange(3) / 10 + 0.015)

    assert len(associate(poses(3), later, "timestamp")[0]) == 0
    assert len(associate(poses(3), later, "timestamp", 0.02)[0]) == 3


def test_files_without_times_are_associated_by_order_where_they_have_as_many_poses(tmp_path: Path) -> None:
    a, b, c = (kitti(count, tmp_path / str(index)) for index, count in enumerate((6, 6, 5)))

    assert association_of([a, b]) == "order"
    assert associate(a, b, "order")[1].tolist() == [0, 1, 2, 3, 4, 5]
    with pytest.raises(TrajectoryError, match="6 poses that are only numbered by their order and another has 5"):
        association_of([a, b, c])


def test_times_are_no_match_for_lines(tmp_path: Path) -> None:
    with pytest.raises(TrajectoryError, match="only numbered by their order"):
        association_of([tum(6, tmp_path / "tum"), kitti(5, tmp_path / "kitti")])


def test_images_called_by_numbers_meet_frame_ids(tmp_path: Path) -> None:
    numbered = model(["0000.png", "0002.png", "0003.png"], tmp_path / "numbered")

    assert association_of([numbered, poses(4)]) == "frame id"
    assert associate(poses(4), numbered, "frame id")[0].tolist() == [0, 2, 3]


def test_a_trajectory_knows_where_it_was_read_from(tmp_path: Path) -> None:
    assert tum(3, tmp_path / "a.txt").select(np.arange(2)).source == str(tmp_path / "a.txt")
