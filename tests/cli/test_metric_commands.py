import json
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
        ((TIMES - TIMES[0]) * 1e9, "those of est.txt look like nanoseconds: divide them by 1e9"),
        (
            TIMES + 100,
            "est.txt begins 97.25 s after the end of gt.txt: give both by the same clock, or the difference of the "
            "clocks as --offset (-100 if both begin at once)",
        ),
        (
            TIMES - TIMES[0],
            "gt.txt begins 1.30503e+09 s after the end of est.txt: give both by the same clock, or the difference of "
            "the clocks as --offset (1305031098.5 if both begin at once)",
        ),
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
    assert "est.kitti is a KITTI file, which holds no times, only lines, so nothing says which" in said.err


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


def models(folder: Path, names: list[str], walk: Trajectory) -> None:
    """Write the poses of a walk as a model whose rotations are the identity, so that t = -C."""
    folder.mkdir()
    lines = [
        f"{n + 1} 1 0 0 0 {' '.join(map(repr, (-walk.positions[n]).tolist()))} 1 {name}\n\n"
        for n, name in enumerate(names)
    ]
    (folder / "images.txt").write_text("".join(lines))


@pytest.mark.parametrize("lost", ["start", "middle"])
def test_kitti_files_of_different_lengths_are_refused(cli: Cli, walk: Trajectory, lost: str) -> None:
    write_kitti(walk, "gt.kitti")
    write_kitti(walk.select(np.arange(2, 12) if lost == "start" else np.arange(12) != 5), "est.kitti")

    said = cli("metric", "ate", "gt.kitti", "est.kitti")

    assert said.code == 1
    assert "gt.kitti, a KITTI file, has 12 poses and est.kitti, a KITTI file, has 1" in said.err
    assert "can only be matched in order, where both have a pose of every frame" in said.err


@pytest.mark.parametrize("name", ["frame_{:05d}.jpg", "{:06d}.png", "x{0}y.png"])
def test_a_model_and_lines_are_refused_where_the_counts_differ(cli: Cli, walk: Trajectory, name: str) -> None:
    write_kitti(walk, "gt.kitti")
    models(Path("model"), [name.format(n) for n in range(2, 12)], walk)

    said = cli("metric", "ate", "gt.kitti", "model")

    assert said.code == 1
    assert "gt.kitti, a KITTI file, has 12 poses and model, a COLMAP model, has 10" in said.err


@pytest.mark.parametrize("name", ["{:.6f}.png", "{:.0f}.png"])
def test_a_model_of_images_called_by_times_meets_a_file_with_times(cli: Cli, walk: Trajectory, name: str) -> None:
    scale = 1 if "6" in name else 1e9
    kept = [n for n in range(12) if n != 5]
    models(Path("model"), [name.format(TIMES[n] * scale) for n in kept], walk.select(np.array(kept)))

    said = cli("metric", "ate", "gt.txt", "model", "--json")

    assert json.loads(said.out)["count"] == 11
    assert json.loads(said.out)["rmse"] < 1e-9


def test_an_offset_is_added_to_the_times_of_the_estimate(cli: Cli, walk: Trajectory) -> None:
    write_tum(replace(walk, timestamps=TIMES - 12.5), "est.txt")

    said = cli("metric", "ate", "gt.txt", "est.txt", "--offset", "12.5", "--json")

    assert json.loads(said.out)["count"] == 12
    assert cli("metric", "rpe", "gt.txt", "est.txt", "--offset", "12.25", "--json").code == 0
    assert "expected a number of seconds" in cli("metric", "ate", "gt.txt", "est.txt", "--offset", "nan").err


def test_an_offset_without_times_is_refused(cli: Cli, walk: Trajectory) -> None:
    write_kitti(walk, "est.kitti")

    assert "--offset shifts times" in cli("metric", "ate", "est.kitti", "est.kitti", "--offset", "1").err


@pytest.mark.parametrize(("flag", "separator"), [("|", "|"), ("tab", "\t"), (",", ","), (";", ";")])
def test_a_delimiter_can_be_given(cli: Cli, walk: Trajectory, flag: str, separator: str) -> None:
    lines = Path("gt.txt").read_text().splitlines()[1:]
    header = "timestamp tx ty tz qx qy qz qw"
    Path("est.csv").write_text("\n".join(line.replace(" ", separator) for line in [header, *lines]))
    Path("gt.csv").write_text(Path("est.csv").read_text())

    assert json.loads(cli("metric", "ate", "gt.csv", "est.csv", "--delimiter", flag, "--json").out)["rmse"] < 1e-9


def test_seconds_between_poses_need_times(cli: Cli, walk: Trajectory) -> None:
    write_kitti(walk, "est.kitti")

    said = cli("metric", "rpe", "est.kitti", "est.kitti", "--unit", "seconds")

    assert said.code == 1
    assert "the trajectory has none, as for KITTI files; give the distance in frames" in said.err
