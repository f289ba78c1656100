"""The demo goes the way of `gtf-tune tune`, with ground truth beside its outcome."""

from pathlib import Path

import pytest

from gtf_tune.cli import demo
from gtf_tune.definition import read_toml
from gtf_tune.pipelines import create_pipeline
from gtf_tune.store import studies
from gtf_tune.store.database import open_database
from gtf_tune.study.create import checked_definition
from gtf_tune.study.outcome.recommendation import recommend
from tests.cli.conftest import Cli

OPTION = "filter.max_error"
CREATE = ("study", "create", "demo", "-p", "analytic", "-s", "room", "-k", "2", "-K", "4", "--sampler", "grid")


def test_the_outcome_of_the_demo_stands_beside_the_truth(
    cli: Cli, room: Path, capfd: pytest.CaptureFixture[str]
) -> None:
    assert room.is_dir()
    cli(*CREATE, "-v", f"{OPTION}=0.01,0.003,0.05")
    cli("study", "run", "demo", "--jobs", "1")
    database = open_database("gtf-tune.db")
    study = studies.get(database, "demo")
    found = recommend(database, study)
    capfd.readouterr()

    demo.write_truth(database, study)

    out = capfd.readouterr().out
    rows = {line.split()[1]: line.split()[-1] for line in out.splitlines()[1:4]}
    assert rows["-"] == "nominal"
    assert found.trial is not None
    assert rows[f"max_error={(found.trial.options or {})[OPTION]}"] == "use"
    assert "ground-truth ATE of the trial to use, which the search never saw: -" in out
    assert "the best trial by ground truth itself: -" in out


def test_the_definition_of_the_demo_is_one_that_tune_takes(tmp_path: Path) -> None:
    path = tmp_path / "demo.toml"
    path.write_text(demo._DEFINITION)

    checked = checked_definition(
        {**read_toml(path), "space": {"mapper.max_normalized_reproj_error": {"values": [1e-3]}}}, "d"
    )

    create_pipeline("glomap").options.check(checked.pipeline.options)
    assert checked.sequences[0].path == "room"
