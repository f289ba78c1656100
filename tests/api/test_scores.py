"""Score the trajectory files of any program."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

import gtf_tune as gtf
from gtf_tune.gtf import GtfSettings, gtf_score
from gtf_tune.trajectory import write_kitti, write_tum

FRAMES = 12


def walk(seed: int, spread: float) -> gtf.Trajectory:
    """A jerky walk with errors of ``spread`` times its usual step."""
    positions = np.random.default_rng(3).normal(size=(FRAMES, 3)).cumsum(axis=0)
    positions += spread * np.random.default_rng(seed).normal(size=positions.shape)
    upright = np.tile([0.0, 0.0, 0.0, 1.0], (FRAMES, 1))
    return gtf.Trajectory(np.arange(FRAMES), np.arange(FRAMES) / 10, positions, upright)


def without(pose: int) -> np.ndarray:
    return np.arange(FRAMES) != pose


CLEAN = [walk(seed, 1e-3) for seed in range(2)]
NOISY = [walk(seed, 2e-2) for seed in range(10, 16)]


@pytest.fixture
def files(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.chdir(tmp_path)
    for kind, runs in (("clean", CLEAN), ("noisy", [run.select(without(5)) for run in NOISY])):
        (tmp_path / kind).mkdir()
        for index, run in enumerate(runs):
            write_tum(run, tmp_path / kind / f"run{index}.txt")
    return tmp_path


def write_model(folder: Path, run: gtf.Trajectory, name: str = "view_{:02d}.png") -> None:
    folder.mkdir(parents=True)
    rows = [
        f"1 1 0 0 0 {-x!r} {-y!r} {-z!r} 1 {name.format(frame)}\n\n"
        for frame, (x, y, z) in zip(run.frame_ids.tolist(), run.positions.tolist(), strict=True)
    ]
    (folder / "images.txt").write_text("".join(rows))


def test_a_missing_pose_does_not_change_which_poses_are_compared(files: Path) -> None:
    """The six noisy files lack the sixth pose; matched by their lines they would score 80 times as much."""
    score = gtf.gtf_ate(gtf.load_trajectories("clean/"), gtf.load_trajectories("noisy/"))

    kept = [run.select(without(5)) for run in NOISY]
    expected = gtf_score(CLEAN, kept, GtfSettings(aggregate="median"), FRAMES)
    by_lines = [replace(run, frame_ids=np.arange(FRAMES - 1)) for run in kept]
    wrong = gtf_score(CLEAN, by_lines, GtfSettings(aggregate="median"), FRAMES)
    assert score.value == pytest.approx(expected.value, rel=1e-9)
    assert wrong.value > 20 * score.value
    np.testing.assert_allclose(score.matrix, expected.matrix, rtol=1e-9)
    assert score.interval == pytest.approx(expected.confidence_interval, rel=1e-9)
    assert (score.matched == FRAMES - 1).all()
    assert (score.association, score.unit) == ("timestamp", "extent")
    assert score.clean == ("clean/run0.txt", "clean/run1.txt")


def test_models_are_compared_by_image_name(tmp_path: Path) -> None:
    for index, run in enumerate(CLEAN):
        write_model(tmp_path / "clean" / str(index), run)
    for index, run in enumerate(NOISY):
        write_model(tmp_path / "noisy" / f"run{index}" / "sparse" / "0", run.select(without(index)))

    score = gtf.gtf_ate(gtf.load_trajectories(tmp_path / "clean"), gtf.load_trajectories(tmp_path / "noisy"))

    kept = [run.select(without(index)) for index, run in enumerate(NOISY)]
    assert score.association == "name"
    assert score.value == pytest.approx(gtf_score(CLEAN, kept, GtfSettings(aggregate="median"), FRAMES).value, rel=1e-9)


def test_files_without_times_are_compared_line_by_line_where_they_have_as_many(tmp_path: Path) -> None:
    for index, run in enumerate([*CLEAN, *NOISY]):
        write_kitti(run, tmp_path / f"{index}.kitti")
    read = gtf.load_trajectories(tmp_path)

    score = gtf.gtf_ate(read[:2], read[2:], aggregate="mean", normalise="none")

    assert (score.association, score.unit) == ("order", "none")
    assert score.value == pytest.approx(gtf_score(CLEAN, NOISY, GtfSettings(normalise="none"), FRAMES).value, rel=1e-9)


def test_files_without_times_that_differ_in_length_are_refused(tmp_path: Path) -> None:
    for index, run in enumerate([*CLEAN, NOISY[0].select(without(5))]):
        write_kitti(run, tmp_path / f"{index}.kitti")
    read = gtf.load_trajectories(tmp_path)

    with pytest.raises(gtf.GtfTuneError, match="12 poses that are only numbered by their order and another has 11"):
        gtf.gtf_ate(read[:2], read[2:])


def test_a_failed_run_has_no_error_and_says_why() -> None:
    score = gtf.gtf_ate(CLEAN, [*NOISY, gtf.Trajectory.empty()])

    assert np.isnan(score.matrix[:, 6]).all()
    assert score.pair_errors[0, 6] == "expected at least 4 matched frames to compare trajectories, not 0"
    assert score.value == gtf.gtf_ate(CLEAN, NOISY).value


def test_a_run_that_fell_apart_is_marked() -> None:
    apart = replace(NOISY[0], positions=NOISY[0].positions[::-1])

    score = gtf.gtf_ate(CLEAN, [apart, *NOISY[1:]])

    assert score.collapsed.tolist() == [True, False, False, False, False, False]


def test_other_clocks_are_refused_with_the_files(files: Path) -> None:
    for path in Path("noisy").iterdir():
        write_tum(replace(walk(0, 0.0), timestamps=1e6 + np.arange(FRAMES) / 10), path)

    with pytest.raises(gtf.GtfTuneError, match=r"clean/run0\.txt and noisy/run0\.txt, .* by timestamp: .* clock"):
        gtf.gtf_ate(gtf.load_trajectories("clean"), gtf.load_trajectories("noisy"))


def test_no_trajectories_are_refused() -> None:
    with pytest.raises(gtf.GtfTuneError, match="at least one noisy trajectory"):
        gtf.gtf_ate(CLEAN, [gtf.Trajectory.empty()])


def test_a_score_prints_in_one_line() -> None:
    text = str(gtf.gtf_ate(CLEAN, NOISY))

    assert text.startswith("GTF ATE ")
    assert "per mille of the extent (95 % interval" in text
    assert text.endswith("2 clean and 6 noisy trajectories associated by timestamp)")


def test_trajectories_come_in_natural_order(files: Path) -> None:
    for index in (2, 10):
        write_tum(CLEAN[0], files / "clean" / f"run{index}.txt")

    assert [Path(run.source).stem for run in gtf.load_trajectories("clean")] == ["run0", "run1", "run2", "run10"]


def test_patterns_files_and_folders_can_be_mixed(files: Path) -> None:
    write_model(files / "model", CLEAN[0])

    found = gtf.load_trajectories("clean/run1.txt", "noisy/run[45].txt", files / "model")

    assert [run.source for run in found] == ["clean/run1.txt", "noisy/run4.txt", "noisy/run5.txt", str(files / "model")]


def test_other_files_of_a_folder_are_left_alone(files: Path) -> None:
    (files / "clean" / "plot.png").write_bytes(b"\x89PNG")
    (files / "clean" / ".run9.txt").write_text("left by an editor")
    (files / "clean" / "logs").mkdir()

    assert len(gtf.load_trajectories("clean")) == 2


def test_of_several_models_in_one_folder_the_largest_is_taken(tmp_path: Path) -> None:
    write_model(tmp_path / "runs" / "a" / "sparse" / "0", CLEAN[0].select(np.arange(3)))
    write_model(tmp_path / "runs" / "a" / "sparse" / "1", CLEAN[0])

    for place in ("runs", "runs/a"):
        assert [len(run) for run in gtf.load_trajectories(tmp_path / place)] == [FRAMES]


@pytest.mark.parametrize("place", ["nowhere", "no*where", "empty"])
def test_a_place_without_trajectories_is_named(tmp_path: Path, place: str) -> None:
    (tmp_path / "empty").mkdir()

    with pytest.raises(gtf.GtfTuneError, match="trajectory files or COLMAP models at"):
        gtf.load_trajectories(tmp_path / place)


def test_a_file_that_is_no_trajectory_is_named(files: Path) -> None:
    (files / "clean" / "readme.txt").write_text("hello world\n")

    with pytest.raises(gtf.GtfTuneError, match=r"readme\.txt"):
        gtf.load_trajectories("clean")
