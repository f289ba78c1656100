"""Frame ids that only count the poses of a file are marked, and matched only where both sides have the same ones."""

from pathlib import Path

import numpy as np
import pytest

from gtf_tune.errors import TrajectoryError
from gtf_tune.gtf import GtfSettings, gtf_score
from gtf_tune.metrics import ate
from gtf_tune.trajectory import (
    Trajectory,
    associate_by_frame_id,
    associate_by_timestamp,
    from_bytes,
    matched,
    read_trajectory,
    to_bytes,
    write_kitti,
    write_tum,
)

FRAMES = 12


def walk(seed: int = 0) -> Trajectory:
    positions = np.random.default_rng(7).normal(size=(FRAMES, 3)).cumsum(axis=0)
    positions += 1e-3 * np.random.default_rng(seed).normal(size=positions.shape)
    upright = np.tile([0.0, 0.0, 0.0, 1.0], (FRAMES, 1))
    return Trajectory(np.arange(FRAMES), np.arange(FRAMES) / 10, positions, upright)


def file_of(trajectory: Trajectory, path: Path) -> Path:
    write_tum(trajectory, path)
    return path


def without(pose: int) -> np.ndarray:
    return np.arange(FRAMES) != pose


def test_text_files_have_counted_ids(tmp_path: Path) -> None:
    write_kitti(walk(), tmp_path / "poses.txt")
    euroc = "".join(f"{10**8 * n},{n},{n * n},0,1,0,0,0\n" for n in range(5))
    (tmp_path / "euroc.csv").write_text(f"#timestamp,px,py,pz,qw,qx,qy,qz\n{euroc}")

    for path in (file_of(walk(), tmp_path / "tum.txt"), tmp_path / "poses.txt", tmp_path / "euroc.csv"):
        assert read_trajectory(path).ids_are_counted


@pytest.mark.parametrize(
    ("name", "counted"), [("{:04d}.png", False), ("view_{:04d}.png", False), ("{:04d}a.png", True)]
)
def test_models_have_the_numbers_of_their_images_or_counted_ids(tmp_path: Path, name: str, counted: bool) -> None:
    lines = "".join(f"{n} 1 0 0 0 0 {n} {n * n} 1 {name.format(n)}\n\n" for n in (2, 3, 5))
    (tmp_path / "images.txt").write_text(lines)

    found = read_trajectory(tmp_path)

    assert found.ids_are_counted is counted
    assert found.frame_ids.tolist() == ([0, 1, 2] if counted else [2, 3, 5])


def test_the_mark_stays_with_a_choice_of_poses_and_goes_with_other_ids(tmp_path: Path) -> None:
    found = read_trajectory(file_of(walk(), tmp_path / "a.txt"))

    assert found.select(without(4)).ids_are_counted
    assert found.transformed(2.0, np.eye(3), np.zeros(3)).ids_are_counted
    assert not found.with_frame_ids(np.arange(FRAMES)).ids_are_counted


def test_counted_ids_that_differ_are_not_matched(tmp_path: Path) -> None:
    clean = [read_trajectory(file_of(walk(seed), tmp_path / f"clean{seed}.txt")) for seed in range(2)]
    noisy = [read_trajectory(file_of(walk(9).select(without(5)), tmp_path / "noisy.txt"))]

    for compare in (
        lambda: gtf_score(clean, noisy, GtfSettings(), FRAMES),
        lambda: ate(clean[0], noisy[0]),
        lambda: associate_by_frame_id(clean[0], noisy[0]),
        lambda: associate_by_frame_id(walk(), noisy[0]),
        lambda: gtf_score(clean, [walk().select(without(5))], GtfSettings(), FRAMES),
    ):
        with pytest.raises(TrajectoryError, match=r"one trajectory has 1[12] poses that are only numbered by their"):
            compare()


def test_counted_ids_are_matched_where_the_counts_agree(tmp_path: Path) -> None:
    read = [read_trajectory(file_of(walk(seed), tmp_path / f"{seed}.txt")) for seed in range(3)]

    assert ate(read[0], read[1]) == pytest.approx(ate(walk(0), walk(1)), rel=1e-12)
    assert gtf_score(read[:1], [read[2], Trajectory.empty()], GtfSettings(), FRAMES).pair_errors.keys() == {(0, 1)}


def test_what_was_associated_by_time_is_matched(tmp_path: Path) -> None:
    clean = read_trajectory(file_of(walk(0), tmp_path / "clean.txt"))
    noisy = read_trajectory(file_of(walk(1).select(without(5)), tmp_path / "noisy.txt"))

    found = ate(*matched(clean, noisy, associate_by_timestamp(clean, noisy)))

    assert found == pytest.approx(ate(walk(0), walk(1).select(without(5))), rel=1e-12)


def test_stored_trajectories_have_real_ids(tmp_path: Path) -> None:
    counted = read_trajectory(file_of(walk(), tmp_path / "a.txt"))

    assert not from_bytes(to_bytes(walk())).ids_are_counted
    with pytest.raises(TrajectoryError, match="only numbered by their order"):
        to_bytes(counted)
