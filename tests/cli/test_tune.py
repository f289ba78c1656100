"""One command goes from images to an outcome, and goes on where it stopped."""

import json
import math
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import cv2
import numpy as np
import pytest

from gtf_tune.cli.tune import _verdict
from gtf_tune.study.outcome.improvement import Improvement
from gtf_tune.study.tune import start
from gtf_tune.study.tune.choice import TooLittleTime
from gtf_tune.study.tune.pace import Pace
from tests.cli.conftest import Cli

DEFINITION = """
[pipeline]
name = "analytic"

[[sequences]]
name = "room"
path = "room"

[space]
"filter.max_error" = { low = 1e-3, high = 1e-1, log = true }

[search]
trials = 5
"""
TUNE = ("tune", "slam.toml", "--minutes", "2", "--jobs", "1")


@pytest.fixture
def slam(room: Path) -> Path:
    path = room.with_name("slam.toml")
    path.write_text(DEFINITION)
    return path


def test_tune_goes_from_a_definition_to_options_trajectories_and_a_report(cli: Cli, slam: Path) -> None:
    done = cli(*TUNE)

    assert done.code == 0, done.err
    folder = slam.with_name("slam-tuned")
    assert {path.name for path in folder.iterdir()} >= {
        "options.json",
        "options-nominal.json",
        "trajectory.txt",
        "trajectory-nominal.txt",
        "report.html",
    }
    phases = [done.err.index(word) for word in ("inspect:", "estimate:", "plan:", "search:", "confirm:", "write:")]
    assert phases == sorted(phases)
    best = json.loads(cli("study", "best", "slam", "--json").out)
    assert best["headline"] in done.out


@pytest.mark.parametrize(
    ("decision", "low", "said"),
    [
        ("adopt", 0.367, ("Adopt a.b = 0.1: the trajectory moves 51 % less under noise (95 %: 37 to 62 %).",)),
        ("unconfirmed", math.nan, ("Not confirmed yet: a.b = 0.1: the trajectory moves 51 % less under noise.",)),
        ("keep nominal", 0.367, ()),
    ],
)
def test_the_verdict_names_what_to_change_and_what_it_gains(decision: str, low: float, said: tuple[str, ...]) -> None:
    trial = SimpleNamespace(options={"a.b": 0.1, "c": 3})
    found: Any = SimpleNamespace(decision=decision, trial=trial, improvement=Improvement(0.509, low, 0.619, 7))

    assert _verdict(found, {"a.b": 1.0, "c": 3}) == said


def test_calling_tune_again_goes_on_and_new_begins_another_study(cli: Cli, slam: Path) -> None:
    cli(*TUNE)

    again = cli(*TUNE)
    other = cli(*TUNE, "--new")

    assert "going on with study 'slam'; --new begins another one" in again.err
    assert "created study 'slam-2'" in other.err
    assert {line.split()[0] for line in cli("study", "list").out.splitlines()[1:]} == {"slam", "slam-2"}


def test_minutes_that_buy_no_comparison_leave_nominal_and_say_how_many_would(
    cli: Cli, slam: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    with monkeypatch.context() as patch:
        patch.setattr(start, "choose", lambda *_: TooLittleTime(spent_s=100.0, more_s=600.0))
        done = cli(*TUNE)

    assert done.code == 0, done.err
    assert done.out.startswith("Nothing was compared: 2 minutes buy the nominal reconstruction only; ")
    assert "to compare anything on these images needs about 12 minutes, or 10 when the same command goes on" in done.out
    folder = slam.with_name("slam-tuned")
    assert (folder / "trajectory.txt").read_text() == (folder / "trajectory-nominal.txt").read_text()
    assert "NOMINAL options (tuning has not ended)." in (folder / "README.txt").read_text()
    assert cli("study", "list").out == ""


def test_a_search_that_the_clock_stops_ends_with_nominal_and_goes_on_when_called_again(
    cli: Cli, slam: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    with monkeypatch.context() as patch:
        patch.setattr(Pace, "trial_is_hopeless", property(lambda pace: pace.done == 1 and pace._runs == 1))
        stopped = cli(*TUNE)
    again = cli(*TUNE)

    assert stopped.code == 0, stopped.err
    assert "Keep the nominal options so far. No other trial has ended, so nothing was compared." in stopped.out
    assert " of 4 runs of trial 1 are stored; the same command with more minutes goes on" in stopped.err
    assert "going on with study 'slam'" in again.err
    assert "nothing was compared" not in again.out


def test_a_folder_that_tune_did_not_make_is_not_replaced(cli: Cli, slam: Path) -> None:
    precious = slam.with_name("slam-tuned")
    precious.mkdir()
    (precious / "thesis.tex").write_text("precious")

    refused = cli(*TUNE)

    assert refused.code == 1
    assert "holds something else; choose another output folder or remove it" in refused.err
    assert (precious / "thesis.tex").read_text() == "precious"


def test_a_nominal_that_does_not_work_is_said_before_a_study_is_made(cli: Cli, slam: Path) -> None:
    slam.write_text(DEFINITION.replace('name = "analytic"', 'name = "analytic"\nsettings = { failure = "error" }', 1))

    refused = cli(*TUNE)

    assert refused.code == 1
    assert "the nominal options do not work on 'room': the analytic pipeline was told to fail" in refused.err
    assert cli("study", "list").out == ""


def test_a_pipeline_about_which_nothing_says_what_to_search_is_one_sentence(cli: Cli, room: Path) -> None:
    refused = cli("tune", "room", "--pipeline", "analytic")

    assert refused.code == 1
    assert "nothing says what to search on pipeline 'analytic'; name the options" in refused.err


def test_a_video_is_taken_apart_once(cli: Cli, tmp_path: Path) -> None:
    film = cv2.VideoWriter(str(tmp_path / "walk.avi"), cv2.VideoWriter.fourcc(*"MJPG"), 10.0, (64, 48))
    for number in range(40):
        film.write(np.full((48, 64, 3), 6 * number, dtype=np.uint8))
    film.release()

    first, again = (cli("tune", "walk.avi", "--pipeline", "analytic") for _ in range(2))

    assert "taking the sharpest frame of each half second of walk.avi" in first.err
    assert "taking" not in again.err
    assert len(list((tmp_path / "walk-frames").rglob("*.png"))) == 8
    assert "nothing says what to search on pipeline 'analytic'" in again.err
