from pathlib import Path

import pytest

from gtf_tune.cli import demo
from gtf_tune.store import studies
from gtf_tune.store.database import open_database
from gtf_tune.study.outcome.recommendation import recommend
from tests.cli.conftest import Cli

OPTION = "filter.max_error"
CREATE = ("study", "create", "demo", "-p", "analytic", "-s", "room", "-k", "2", "-K", "4", "--sampler", "grid")


def test_the_outcome_of_the_demo_stands_beside_the_truth(
    cli: Cli, room: Path, monkeypatch: pytest.MonkeyPatch, capfd: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr(demo, "_OPTION", OPTION)
    cli(*CREATE, "-v", f"{OPTION}=0.01,0.003,0.05")
    cli("study", "run", "demo", "--jobs", "1")
    database = open_database("gtf-tune.db")
    study = studies.get(database, "demo")
    found = recommend(database, study)
    capfd.readouterr()

    demo._write_outcome(database, study)

    out = capfd.readouterr().out
    rows = {line.split()[0]: line.split()[-1] for line in out.splitlines()[1:4]}
    assert rows["0.01"] == "nominal"
    assert rows[str(((found.trial and found.trial.options) or {})[OPTION])] == "best"
    assert found.headline in out
    assert "ground-truth ATE of that trial, which the search never saw: -" in out
    assert "rank correlation of GTF ATE and ground-truth ATE over 3 trials: +" in out
