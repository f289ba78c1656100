"""``gtf-tune metric gtf`` scores the trajectory files of any program."""

import json
from pathlib import Path

import numpy as np
import pytest

import gtf_tune as gtf
from gtf_tune.trajectory import write_kitti, write_tum
from tests.cli.conftest import Cli

FRAMES = 12


def walk(seed: int, spread: float) -> gtf.Trajectory:
    positions = np.random.default_rng(3).normal(size=(FRAMES, 3)).cumsum(axis=0)
    positions += spread * np.random.default_rng(seed).normal(size=positions.shape)
    upright = np.tile([0.0, 0.0, 0.0, 1.0], (FRAMES, 1))
    return gtf.Trajectory(np.arange(FRAMES), np.arange(FRAMES) / 10, positions, upright)


@pytest.fixture
def files(tmp_path: Path) -> None:
    for kind, count, spread in (("clean", 2, 1e-3), ("noisy", 6, 2e-2)):
        for index in range(count):
            folder = tmp_path / "runs" / f"{kind}{index}"
            folder.mkdir(parents=True)
            kept = np.arange(FRAMES) != (5 if kind == "noisy" else -1)
            write_tum(walk(10 * count + index, spread).select(kept), folder / "poses.txt")


@pytest.mark.usefixtures("files")
def test_it_prints_what_python_returns(cli: Cli) -> None:
    said = cli("metric", "gtf", "--clean", "runs/clean*/poses.txt", "--noisy", "runs/noisy*/poses.txt", "--json")

    found = json.loads(said.out)
    expected = gtf.gtf_ate(gtf.load_trajectories("runs/clean*/*"), gtf.load_trajectories("runs/noisy*/*"))
    assert found["value"] == expected.value
    assert found["interval"] == list(expected.interval)
    assert found["matrix"] == expected.matrix.tolist()
    assert found["association"] == "timestamp"
    assert found["unit"] == "extent"
    assert found["clean"] == ["runs/clean0/poses.txt", "runs/clean1/poses.txt"]
    assert found["pair_errors"] == []


@pytest.mark.usefixtures("files")
def test_people_see_the_score_the_interval_and_the_matrix(cli: Cli) -> None:
    said = cli("metric", "gtf", "--clean", "runs/clean0", "--clean", "runs/clean1/*", "--noisy", "runs/noisy*/*.txt")

    assert said.code == 0
    lines = said.out.splitlines()
    assert lines[0].startswith("GTF ATE")
    assert "‰ of extent" in lines[0]
    assert " to " in lines[1]
    assert lines[2].split() == ["associated", "by", "timestamp"]
    assert lines[3].split() == ["matched", "poses", "11"]
    assert lines[6].split()[-6:] == [f"noisy{index}" for index in range(6)]
    assert [line.split()[0] for line in lines[7:9]] == ["clean0", "clean1"]


@pytest.mark.usefixtures("files")
def test_a_file_with_too_few_poses_is_named(cli: Cli) -> None:
    write_tum(walk(0, 0.0).select(np.arange(3)), "runs/noisy9.txt")

    said = cli("metric", "gtf", "--clean", "runs/clean*/*", "--noisy", "runs/noisy9.txt", "--noisy", "runs/noisy0/*")

    assert "runs/clean0/poses.txt and runs/noisy9.txt: expected at least 4 matched frames" in said.out


def test_what_cannot_be_associated_is_one_sentence(cli: Cli) -> None:
    for index in range(2):
        write_kitti(walk(index, 0.0).select(np.arange(FRAMES - index)), f"{index}.kitti")

    said = cli("metric", "gtf", "--clean", "0.kitti", "--noisy", "1.kitti")

    assert said.code == 1
    assert said.err.count("\n") == 1
    assert "only numbered by their order" in said.err


def test_both_kinds_are_required(cli: Cli) -> None:
    assert cli("metric", "gtf", "--clean", "anything").code == 2
