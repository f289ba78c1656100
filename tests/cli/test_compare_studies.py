"""Several studies are put side by side by what they picked and what ground truth says of it."""

import math
from dataclasses import replace
from pathlib import Path

import pytest

from gtf_tune.errors import DefinitionError, StorageError
from gtf_tune.store import ground_truth_errors, trials
from gtf_tune.store.database import create_database
from gtf_tune.study.ground_truth.comparison import ComparedStudy, Comparison, compare_studies
from tests.cli.conftest import Cli
from tests.cli.test_study_commands import AXIS, CREATE

ROW = ComparedStudy("a", "room", "", {"x": 1.0}, "unconfirmed", -0.2, true_nominal=2.0, true_pick=1.5, true_best=1.0)


def test_changes_are_relative_to_nominal() -> None:
    found = Comparison((ROW, replace(ROW, true_pick=2.5), replace(ROW, true_nominal=None)))

    assert (ROW.true_change, ROW.best_change) == (-0.25, -0.5)
    assert (len(found.judged), found.improved) == (2, 1)
    assert found.mean_change == 0.0
    assert found.mean_best_change == -0.5
    assert "in 1 of 2; mean change +0.0 %, of -50.0 %" in found.sentence


def test_without_ground_truth_nothing_is_claimed() -> None:
    found = Comparison((replace(ROW, true_nominal=None),))

    assert math.isnan(found.mean_change)
    assert found.sentence == "No study here has ground truth of nominal and of its pick."


def test_rows_say_what_the_studies_picked_and_are_sorted_by_a_number(cli: Cli, room: Path, tmp_path: Path) -> None:
    for sigma in ("8", "10", "2"):
        cli(*["s" + sigma if word == "small" else word for word in CREATE], *AXIS, "--noise-sigma", sigma)
        assert cli("study", "run", f"s{sigma}", "--jobs", "1").code == 0
    database = create_database(str(tmp_path / "gtf-tune.db"))

    found = compare_studies(database, ["s8", "s10", "s2", "s8"], by="noise_sigma")

    assert [(row.study, row.by) for row in found.rows] == [("s2", "2"), ("s8", "8"), ("s10", "10")]
    row = found.rows[0]
    stored = [trial for trial in trials.of_study(database, 1) if trial.feasible]
    lowest = min(stored, key=lambda trial: trial.value or math.inf)
    nominal = next(trial for trial in stored if trial.number == 0)
    eight = found.rows[1]
    assert eight.score_change == pytest.approx((lowest.value or 0) / (nominal.value or 1) - 1)
    assert set(row.pick) <= set(nominal.options or {})
    truth = ground_truth_errors.values(database, 1)
    assert eight.true_nominal == truth[0]["room"]
    assert eight.true_best == min(error for errors in truth.values() for error in errors.values() if error is not None)

    said = cli("study", "compare", "s8", "s2", "--by", "noise_sigma")
    assert said.code == 0, said.err
    assert said.out.index("s2") < said.out.index("s8")
    assert found.rows[0].pick_text.split(" = ")[0] in said.out
    with pytest.raises(DefinitionError, match="one of noise_sigma, noisy_runs, option, sequence, not 'colour'"):
        compare_studies(database, ["s8"], by="colour")
    with pytest.raises(StorageError, match="nobody"):
        compare_studies(database, ["nobody"])
