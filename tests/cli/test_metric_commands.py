from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from gtf_tune.trajectory import Trajectory, write_kitti, write_tum
from tests.cli.conftest import Cli

TIMES = 1305031098.5 + np.arange(12) / 4


@pytest.fixture
def walk(tmp_path: Path) -> Trajectory:
    positions = np.cumsum(np.random.default_rng(0).normal(size=(12, 3)), axis=0)
    walked = Trajectory(np.arange(12), TIMES, positions, np.tile([0.0, 0.0, 0.0, 1.0], (12, 1)))
    write_tum(walked, tmp_path / "gt.txt")
    return walked


@pytest.mark.parametrize(
    ("times", "advice"),
    [
        (TIMES * 1e9, "those of est.txt look like nanoseconds: divide them by 1e9"),
        (TIMES + 100, "est.txt begins 97.25 s after the end of gt.txt: give both by the same clock"),
        (TIMES - TIMES[0], "gt.txt begins 1.30503e+09 s after the end of est.txt: give both by the same clock"),
        (TIMES + 0.125, "the nearest two are 0.125 s apart: raise --max-difference, or give both by the same clock"),
    ],
)
def test_times_that_do_not_agree_are_shown_with_what_to_change(
    cli: Cli, walk: Trajectory, times: np.ndarray[tuple[int], np.dtype[np.float64]], advice: str
) -> None:
    write_tum(replace(walk, timestamps=times), "est.txt")

    said = cli("metric", "ate", "gt.txt", "est.txt")

    assert said.code == 1
    assert said.err == (
        "error: expected at least 4 poses that gt.txt and est.txt share, not 0: they were matched by timestamps within "
        f"--max-difference 0.02 s, 1305031098.5 to 1305031101.25 s in gt.txt and {times[0]:.12g} to {times[-1]:.12g} s "
        f"in est.txt; {advice}\n"
    )


def test_a_file_without_times_is_named_where_the_other_has_them(cli: Cli, walk: Trajectory) -> None:
    write_kitti(walk, "est.kitti")

    said = cli("metric", "ate", "gt.txt", "est.kitti")

    assert said.code == 1
    assert "est.kitti is a KITTI file, which holds no times: the numbers of its lines stand for them" in said.err


def test_names_that_do_not_agree_are_shown(cli: Cli, walk: Trajectory) -> None:
    for folder in ("a", "b"):
        lines = "".join(f"{n} 1 0 0 0 0 {n} {n * n} 1 {folder}/{n}.png\n\n" for n in range(1, 6))
        Path(folder).mkdir()
        Path(folder, "images.txt").write_text(lines)

    said = cli("metric", "ate", "a", "b")

    assert "matched by image names, 'a/1.png' to 'a/5.png' in a and 'b/1.png' to 'b/5.png' in b" in said.err


def test_a_trajectory_that_is_too_short_is_named(cli: Cli, walk: Trajectory) -> None:
    write_tum(walk.select(np.arange(3)), "est.txt")

    assert "est.txt holds only 3; give longer trajectories" in cli("metric", "ate", "gt.txt", "est.txt").err


def test_a_negative_difference_is_a_usage_error(cli: Cli, walk: Trajectory) -> None:
    assert cli("metric", "ate", "gt.txt", "gt.txt", "--max-difference", "-1").code == 2


def test_a_delta_that_no_two_poses_are_apart_is_told(cli: Cli, walk: Trajectory) -> None:
    said = cli("metric", "rpe", "gt.txt", "gt.txt", "--delta", "100")

    assert said.code == 1
    assert "expected two of the 12 matched poses 100 frames apart, but no two are; lower --delta" in said.err


def test_rotation_errors_carry_their_unit(cli: Cli, walk: Trajectory) -> None:
    assert "degrees" in cli("metric", "rpe", "gt.txt", "gt.txt", "--relation", "rotation").out
