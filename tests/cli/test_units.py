"""Scores are shown in the unit that the definition gives them, wherever they are shown."""

import re
from pathlib import Path

import pytest

from tests.cli.conftest import Cli
from tests.study.conftest import write_sequence

ROTATION = 'metric = "rpe_rotation"'
RAW = 'normalise = "none"'


RANGE = "{ low = 1e-3, high = 1e-1, log = true }"


def create(cli: Cli, name: str, gtf: str = "", *sequences: str, axis: str = RANGE, sampler: str = "random") -> None:
    tables = "".join(f'[[sequences]]\nname = "{one}"\npath = "{one}"\n' for one in ("room", *sequences))
    Path(f"{name}.toml").write_text(
        f'name = "{name}"\n[pipeline]\nname = "analytic"\n{tables}'
        f'[space]\n"filter.max_error" = {axis}\n'
        f'[gtf]\nclean_runs = 1\nnoisy_runs = 3\n{gtf}\n[search]\nsampler = "{sampler}"\ntrials = 2\n'
    )
    made = cli("study", "create", f"{name}.toml")
    assert made.code == 0, made.err


@pytest.fixture
def studies_of_all_units(cli: Cli, room: Path) -> None:
    write_sequence(Path("hall"), ground_truth=False, frames=11)
    create(cli, "extent")
    create(cli, "raw", RAW)
    create(cli, "rotation", ROTATION)
    create(cli, "two", "", "hall")


UNITS = {
    "extent": r"[\d.]+ per mille",
    "raw": r"[\d.]+ unit of the trajectory",
    "rotation": r"[\d.e-]+ deg",
    "two": r"1 relative to nominal",
}


@pytest.mark.usefixtures("studies_of_all_units")
def test_progress_and_followed_trials_tell_the_unit_of_each_score(cli: Cli) -> None:
    for name, unit in UNITS.items():
        progress = cli("study", "run", name, "--jobs", "1").err
        followed = cli("study", "watch", name).out

        assert re.search(rf"nominal \(.*\): {unit}; 1/2, lowest {unit}, ", progress), progress
        assert re.search(rf"nominal: {unit}, ", followed), followed
        assert ("per mille" in progress + followed) is (name == "extent")


@pytest.mark.usefixtures("studies_of_all_units")
def test_a_workers_log_and_the_list_of_studies_tell_the_unit_of_each_score(cli: Cli) -> None:
    log = cli("worker", "--once", "--jobs", "1").err
    listed = {line.split()[0]: line for line in cli("study", "list").out.splitlines()}

    for name, unit in UNITS.items():
        assert re.search(rf"{name}: trial 0 is done: {unit}\n", log), log
    assert re.search(r"done +2/2 +[\d.]+ +[\d.]+ +‰ of extent ", listed["extent"])
    assert re.search(r"done +2/2 +[\d.]+ +[\d.]+ +unit of the trajectory ", listed["raw"])
    assert re.search(r"done +2/2 +[\d.e-]+ +[\d.e-]+ +deg ", listed["rotation"])
    assert re.search(r"done +2/2 +1 +[\d.]+ +relative to nominal ", listed["two"])
    assert max(map(len, listed.values())) <= 80


def test_a_score_tried_otherwise_has_the_unit_of_what_is_tried(cli: Cli, room: Path) -> None:
    create(cli, "extent")
    cli("study", "run", "extent", "--jobs", "1")

    as_stored = cli("study", "rescore", "extent").out
    as_rotation = cli("study", "rescore", "extent", "--metric", "rpe_rotation").out

    assert "GTF ATE [‰]" in as_stored
    assert "GTF RPE (rotation) [deg]" in as_rotation
    assert "‰" not in as_rotation


def test_a_confirmation_names_the_score_that_it_compares(cli: Cli, room: Path) -> None:
    create(cli, "relative", 'metric = "rpe_translation"', axis="{ values = [0.01, 0.003] }", sampler="grid")
    cli("study", "run", "relative", "--jobs", "1")

    confirmed = cli("study", "confirm", "relative", "--top", "1", "--runs", "4", "--jobs", "1").out

    assert "change of GTF RPE " in confirmed


def test_evaluate_tells_the_unit_of_score_and_true_error(cli: Cli, room: Path) -> None:
    arguments = ("evaluate", "room", "-p", "analytic", "-k", "1", "-K", "3", "-j", "1")

    said = cli(*arguments, "--side", "metric=rpe_rotation").out

    assert re.search(r"GTF ATE +[\d.]+ ‰ of extent \(95 % interval [\d.]+ to [\d.]+\)", said), said
    assert re.search(r"true rotation RPE.* [\d.e-]+ degrees", said), said


def test_evaluate_says_so_where_one_noisy_run_gives_no_interval(cli: Cli, room: Path) -> None:
    said = cli("evaluate", "room", "-p", "analytic", "-k", "1", "-K", "1", "-j", "1").out

    assert re.search(r"GTF ATE +[\d.]+ ‰ of extent \(too few runs for an interval\)", said), said
