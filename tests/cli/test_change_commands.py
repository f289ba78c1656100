import contextlib
import json
import sqlite3
from pathlib import Path

import pytest

from tests.cli.conftest import Cli


@pytest.fixture
def tuned(cli: Cli, room: Path) -> Cli:
    """Return the command line beside a finished study of four trials."""
    space = ("-r", "filter.max_error=1e-3:1e-1:log")
    cli("study", "create", "small", "-p", "analytic", "-s", "room", "-n", "4", "-k", "1", "-K", "3", *space)
    cli("study", "run", "small", "--jobs", "1")
    return cli


def test_rescore_shows_old_and_new_ranks(tuned: Cli) -> None:
    shown = tuned("study", "rescore", "small", "--aggregate", "median")
    found = json.loads(tuned("study", "rescore", "small", "--aggregate", "median", "--json").out)

    assert "the study is unchanged" in shown.err
    assert found["gtf"]["aggregate"] == "median"
    assert sorted(one["rank_before"] for one in found["trials"]) == [1, 2, 3, 4]


def test_rescore_shows_another_error_against_ground_truth_with_its_unit(tuned: Cli) -> None:
    asked = ("study", "rescore", "small", "--side", "metric=rpe_rotation", "--side", "rpe_delta=2")
    shown = tuned(*asked)
    found = json.loads(tuned(*asked, "--json").out)

    assert "[deg]" in shown.out
    assert found["side_metric"]["rpe_delta"] == 2
    assert all(one["gt_rpe_rotation"] == one["ground_truth"]["room"] >= 0 for one in found["trials"])


def _rows(table: str) -> dict[str, list[str]]:
    return {line.split()[0]: line.split() for line in table.splitlines() if line.split()[0:1]}


def test_rescore_marks_trials_that_were_stopped_early(tuned: Cli, tmp_path: Path) -> None:
    with contextlib.closing(sqlite3.connect(tmp_path / "gtf-tune.db", isolation_level=None)) as database:
        database.execute("UPDATE gtf_trial SET state = 'pruned' WHERE ordinal = 1")

    shown = tuned("study", "rescore", "small").out

    assert _rows(shown)["1"][3].endswith("*")
    assert "* stopped early, on fewer noisy runs than the others: never recommended" in shown


def test_rescore_knows_no_collapses_of_trials_without_noisy_runs(cli: Cli, room: Path) -> None:
    space = ("--values", "filter.max_error=0.01,1e-6")
    cli("study", "create", "strict", "-p", "analytic", "-s", "room", "-k", "1", "-K", "3", *space)
    cli("study", "run", "strict", "--jobs", "1")

    shown = cli("study", "rescore", "strict")
    found = json.loads(cli("study", "rescore", "strict", "--json").out)

    assert _rows(shown.out)["1"][3:6] == ["infeasible", "-", "-"]
    assert [one["collapse_rate"] for one in found["trials"]] == [0.0, None]


def test_extend_gives_more_trials(tuned: Cli) -> None:
    tuned("study", "extend", "small", "--trials", "5")
    tuned("study", "run", "small", "--jobs", "1")

    assert len(json.loads(tuned("study", "show", "small", "--json").out)["trials"]) == 5


def test_extend_asks_for_trials_where_none_is_left_to_search_a_wider_range(tuned: Cli) -> None:
    wider = ("-r", "filter.max_error=1e-4:1:log")

    spent = tuned("study", "extend", "small", *wider)
    both = tuned("study", "extend", "small", *wider, "--trials", "6")

    assert spent.err.splitlines()[-1] == "Next: gtf-tune study extend small --trials N"
    assert both.err.splitlines()[-1] == "Next: gtf-tune study run small"


def test_extend_asks_for_more_trials_than_there_are_without_a_word_of_ranges(tuned: Cli) -> None:
    done = len(json.loads(tuned("study", "show", "small", "--json").out)["trials"])

    same = tuned("study", "extend", "small", "--trials", str(done))

    assert "give it more trials" in same.err
    assert "range" not in same.err


def test_extend_says_that_a_full_grid_has_no_more_points(cli: Cli, room: Path) -> None:
    few = ("-k", "1", "-K", "1")
    cli("study", "create", "steps", "-p", "analytic", "-s", "room", "-v", "tracks.min_length=3,4", *few)
    cli("study", "run", "steps", "--jobs", "1")

    full = cli("study", "extend", "steps", "--trials", "30")

    assert "every point of its grid" in full.err
    assert full.err.splitlines()[-1] == "Next: gtf-tune study extend steps --as NEW-NAME --range NAME=LOW:HIGH"


def test_a_paused_study_stays_paused_when_it_is_extended(cli: Cli, room: Path) -> None:
    cli("study", "create", "idle", "-p", "analytic", "-s", "room", "-r", "filter.max_error=1e-3:1e-1:log", "-n", "2")
    cli("study", "pause", "idle")

    said = cli("study", "extend", "idle", "--trials", "5")

    assert json.loads(cli("study", "show", "idle", "--json").out)["state"] == "paused"
    assert said.err.splitlines()[-2:] == [
        "it stays paused until it is resumed",
        "Next: gtf-tune study resume idle",
    ]


def test_extend_refuses_what_cannot_be_compared_and_names_the_way_out(tuned: Cli) -> None:
    refused = tuned("study", "extend", "small", "--noisy-runs", "6")
    derived = tuned("study", "extend", "small", "--noisy-runs", "6", "--as", "more")

    assert refused.code == 1
    assert "--as NEW-NAME" in refused.err
    assert (derived.code, "gtf-tune study run more" in derived.err) == (0, True)


def test_a_colleagues_options_are_enqueued_by_values_or_by_a_file(cli: Cli, room: Path) -> None:
    cli(
        "study",
        "create",
        "small",
        "-p",
        "analytic",
        "-s",
        "room",
        "-n",
        "2",
        "-k",
        "1",
        "-K",
        "2",
        "-r",
        "filter.max_error=1e-3:1e-1:log",
    )
    Path("theirs.json").write_text('{"filter": {"max_error": 0.02}}')

    by_value = cli("study", "enqueue", "small", "-o", "filter.max_error=0.03")
    by_file = cli("study", "enqueue", "small", "-o", "theirs.json")
    waiting = cli("study", "show", "small").out
    refused = cli("study", "enqueue", "small", "-o", "filter.max_error=0.5")
    cli("study", "run", "small", "--jobs", "1")
    shown = json.loads(cli("study", "show", "small", "--json").out)["trials"]

    assert "trial 1 of study 'small' will have these options" in by_value.err
    assert "Next: gtf-tune study run small" in by_file.err
    assert waiting.count("waiting") == 3  # nominal before both
    assert (refused.code, "is searched over [0.001, 0.1], not 0.5" in refused.err) == (1, True)
    assert [one["options"]["filter.max_error"] for one in shown][:3] == [0.01, 0.03, 0.02]
    assert len(shown) == 4
