import json
from pathlib import Path

import optuna
import optuna_dashboard
import pytest

from gtf_tune.store import confirmations, studies
from gtf_tune.store.database import open_database
from gtf_tune.store.optuna.tables import optuna_storage
from gtf_tune.study.outcome.export import FORMATS, formats_of
from tests.cli.conftest import Cli

CREATE = ("study", "create", "small", "-p", "analytic", "-s", "room", "-k", "2", "-K", "4", "--sampler", "grid")
AXIS = ("-v", "filter.max_error=0.01,0.003,0.05")
CONFIRM = ("study", "confirm", "small", "--top", "1", "--runs", "10", "--jobs", "1")


@pytest.fixture
def tuned(cli: Cli, room: Path) -> Cli:
    """Return the command line beside a finished study in which one setting is clearly better than nominal."""
    cli(*CREATE, *AXIS)
    cli("study", "run", "small", "--jobs", "1")
    return cli


def test_best_says_unconfirmed_until_it_is_confirmed(tuned: Cli) -> None:
    before = tuned("study", "best", "small")

    assert "not confirmed yet" in before.out
    assert before.err.endswith("Next: gtf-tune study confirm small\n")
    assert json.loads(tuned("study", "best", "small", "--json").out)["verdict"] == "unconfirmed"


@pytest.mark.drawn
def test_the_note_in_the_dashboard_has_the_verdict(tuned: Cli, tmp_path: Path) -> None:
    def note() -> str:
        database = open_database(str(next(tmp_path.rglob("*.db"))))
        body: str = optuna_dashboard.get_note(optuna.load_study(study_name="small", storage=optuna_storage(database)))
        database.close()
        return body

    assert "not confirmed yet" in note()
    tuned(*CONFIRM)
    assert note().startswith("# Adopt the options of trial ")


def test_a_confirmed_setting_is_the_one_that_best_and_export_give(tuned: Cli) -> None:
    said = tuned(*CONFIRM)
    best = json.loads(tuned("study", "best", "small", "--json").out)
    exported = tuned("study", "export", "small", "--format", "json")

    assert f"Adopt the options of trial {best['recommended']['ordinal']}" in said.out
    assert "p (Holm)" in said.out
    assert best["verdict"] == "adopt"
    assert json.loads(exported.out) == {"filter": {"max_error": best["recommended"]["options"]["filter.max_error"]}}
    assert "Adopt the options of trial" in exported.err


def test_best_says_why_nominal_is_kept(tuned: Cli) -> None:
    found = json.loads(tuned(*CONFIRM, "--json").out)
    database = open_database("gtf-tune.db")
    study = studies.get(database, "small")
    (candidate,) = found["candidates"]
    kept = {**candidate, "verdict": "keep nominal", "reasons": ["2 of 10 noisy runs on room collapsed"]}
    confirmations.add(database, study.id, {}, {**found, "candidates": [kept], "adopted": None}, "keep nominal")
    database.close()

    said = tuned("study", "best", "small").out

    assert "Keep the nominal options" in said
    assert "2 of 10 noisy runs on room collapsed" in " ".join(said.split())


def test_best_says_what_to_do_where_nominal_did_not_work(tuned: Cli) -> None:
    found = json.loads(tuned(*CONFIRM, "--json").out)
    database = open_database("gtf-tune.db")
    (candidate,) = found["candidates"]
    nothing = {**candidate, "verdict": "keep nominal", "improvement": None, "reasons": ["cannot be compared"]}
    result = {**found, "candidates": [nothing], "adopted": None}
    confirmations.add(database, studies.get(database, "small").id, {}, result, "none")
    database.close()

    said = tuned("study", "best", "small")

    assert "Neither the nominal options nor others are recommended" in said.out
    assert "create a study whose nominal options" in said.err
    assert "study confirm" not in said.err


def test_a_setting_that_was_turned_down_is_not_to_be_confirmed_again_where_nominal_failed(cli: Cli, room: Path) -> None:
    # Some runs fail whatever the options are: with this seed nominal's do, and those of another setting do not.
    failing = ("--setting", "failure=error", "--setting", "failure_rate=0.35", "--seed", "1", "-k", "1", "-K", "2")
    axis = ("-v", "filter.max_error=0.02,0.03,0.04,0.05,0.06")
    cli("study", "create", "small", "-p", "analytic", "-s", "room", *axis, *failing)
    cli("study", "run", "small", "--jobs", "1")

    confirmed = cli("study", "confirm", "small", "--runs", "8", "--jobs", "1")
    best = cli("study", "best", "small")
    exported = cli("study", "export", "small", "--format", "json")

    for said in (confirmed.out, best.out, exported.err):
        assert "Neither the nominal options nor others are recommended" in " ".join(said.split())
    assert "study export" not in confirmed.err
    assert "infeasible" in best.out
    assert "On fresh noise none of 2 candidates passed every test" in " ".join(best.out.split())
    assert "study confirm" not in best.err
    assert "create a study whose nominal options" in best.err
    assert (exported.code, exported.out) == (1, "")


def test_a_confirmation_as_json_holds_effect_interval_and_p_value(tuned: Cli) -> None:
    (candidate,) = json.loads(tuned(*CONFIRM, "--json").out)["candidates"]

    assert candidate["low"] < candidate["improvement"] < candidate["high"]
    assert candidate["p_value"] <= candidate["adjusted_p_value"] < 0.05


def test_a_confirmation_of_a_study_that_never_ran_says_what_to_do(cli: Cli, room: Path) -> None:
    cli(*CREATE, *AXIS)

    said = cli(*CONFIRM)

    assert said.code == 1
    assert "gtf-tune study run small" in said.err


def test_the_export_that_is_suggested_is_one_that_the_pipeline_has(tuned: Cli) -> None:
    said = [tuned(*CONFIRM).err, tuned("study", "best", "small").err]

    assert all("Next: gtf-tune study export small --format json\n" in text for text in said)
    assert tuned("study", "export", "small", "--format", "json").code == 0


def test_only_colmaps_pipelines_are_written_as_colmap_reads_them() -> None:
    for name in ("glomap", "colmap", "colmap-hierarchical"):
        assert formats_of(name) == FORMATS
    for name in ("analytic", "command", "droid-slam", "somebody's"):
        assert formats_of(name) == ("json", "csv", "tum")
    assert FORMATS[0] == "colmap"
