"""The scripts in ``examples/`` run as they stand."""

import runpy
import shutil
import sys
from pathlib import Path

import cv2
import numpy as np
import pytest

from gtf_tune.pipelines import analytic
from gtf_tune.trajectory import write_tum
from tests.docs.conftest import quick_command_line
from tests.docs.pages import ROOT
from tests.study.conftest import write_sequence

EXAMPLES = sorted((ROOT / "examples").glob("*.py"))


@pytest.fixture(autouse=True)
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.chdir(tmp_path)
    return tmp_path


def run(name: str, *arguments: str) -> None:
    with pytest.MonkeyPatch.context() as patch, quick_command_line():
        patch.setattr(sys, "argv", [name, *arguments])
        runpy.run_path(str(ROOT / "examples" / name), run_name="__main__")


def write_wall(folder: Path) -> None:
    """Write what a camera sees that slides along a wall, on a loop."""
    folder.mkdir()
    wall = cv2.GaussianBlur(np.random.default_rng(0).integers(0, 255, (120, 140), dtype=np.uint8), (0, 0), 1.0)
    for number in range(12):
        x, y = (int(12 + 12 * turn(number / 12 * 2 * np.pi)) for turn in (np.cos, np.sin))
        cv2.imwrite(str(folder / f"{number:03d}.png"), wall[y : y + 80, x : x + 100])


def test_trajectories_are_scored(folder: Path, capsys: pytest.CaptureFixture[str]) -> None:
    for kind, spread in (("clean", 1e-4), ("noisy", 1e-3)):
        (folder / kind).mkdir()
        for index in range(3):
            truth = analytic.ground_truth(range(20))
            shaken = np.random.default_rng([index, len(kind), int(1e4 * spread)]).normal(scale=spread, size=(20, 3))
            moved = type(truth)(truth.frame_ids, truth.timestamps, truth.positions + shaken, truth.quaternions)
            write_tum(moved, folder / kind / f"run{index}.txt")

    run("score_trajectories.py")

    lines = capsys.readouterr().out.splitlines()
    assert lines[0].startswith("GTF ATE")
    assert [line.split(": moved by")[0] for line in lines[1:]] == [f"noisy/run{index}.txt" for index in range(3)]


def test_a_function_is_tuned(folder: Path, capsys: pytest.CaptureFixture[str]) -> None:
    write_wall(folder / "photos")

    run("tune_function.py")

    assert "'blur':" in capsys.readouterr().out


def test_photographs_are_tuned_and_a_second_start_goes_on(folder: Path, capsys: pytest.CaptureFixture[str]) -> None:
    shutil.move(write_sequence(folder / "full", ground_truth=False) / "rgb", folder / "mine")

    for _ in range(2):
        run("tune_photographs.py", "mine")

    assert capsys.readouterr().out.count("mapper.max_normalized_reproj_error = ") == 2
    assert (folder / "mine-options.html").stat().st_size > 10_000


def test_every_example_is_tested_and_listed() -> None:
    listed = (ROOT / "examples" / "README.md").read_text()

    tested = {"linear_toy.py", "score_trajectories.py", "tune_function.py", "tune_photographs.py"}
    assert {path.name for path in EXAMPLES} == tested
    assert all(f"`{path.name}`" in listed for path in EXAMPLES)
