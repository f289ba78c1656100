import contextlib
import json
import re
import sqlite3
from pathlib import Path

from tests.cli.conftest import Cli
from tests.study.conftest import write_sequence

CREATE = ("study", "create", "small", "-p", "analytic", "-s", "room", "-n", "4", "-k", "1", "-K", "3")
AXIS = ("-r", "filter.max_error=1e-3:1e-1:log")


def test_a_study_goes_from_create_to_export(cli: Cli, room: Path) -> None:
    created = cli(*CREATE, *AXIS)
    ran = cli("study", "run", "small", "--jobs", "1")
    best = json.loads(cli("study", "best", "small", "--json").out)
    exported = json.loads(cli("study", "export", "small", "--format", "json").out)

    assert "storage: sqlite:///gtf-tune.db" in created.err
    assert "4/4" in ran.err
    assert exported == {"filter": {"max_error": best["best"]["options"]["filter.max_error"]}}


def test_tables_fit_eighty_columns(cli: Cli, room: Path) -> None:
    cli(*CREATE, *AXIS)
    cli("study", "run", "small", "--jobs", "1")

    for command in (("list",), ("show", "small"), ("best", "small")):
        lines = cli("study", *command).out.splitlines()
        assert lines
        assert max(map(len, lines)) <= 80


def test_resume_says_what_is_done_and_what_is_left(cli: Cli, room: Path) -> None:
    cli(*CREATE, *AXIS)
    cli("study", "run", "small", "--jobs", "1")

    assert "4 of 4 trials done" in cli("study", "resume", "small").err


def test_show_gives_the_share_of_collapsed_runs_where_there_are_any(cli: Cli, room: Path) -> None:
    cli(*CREATE, *AXIS)
    cli("study", "run", "small", "--jobs", "1")
    cli("study", "create", "fragile", *CREATE[3:-2], "-K", "6", "--setting", "collapse_rate=0.3", *AXIS)
    cli("study", "run", "fragile", "--jobs", "1")

    heads = [cli("study", "show", name).out.partition("  trial ")[2].splitlines()[0] for name in ("small", "fragile")]
    rates = [trial["collapsed_rate"] for trial in json.loads(cli("study", "show", "fragile", "--json").out)["trials"]]

    assert any(rates)
    assert ["collapsed" in head for head in heads] == [False, True]


def test_show_as_json_holds_definition_and_trials(cli: Cli, room: Path) -> None:
    cli(*CREATE, *AXIS)
    cli("study", "run", "small", "--jobs", "1")

    shown = json.loads(cli("study", "show", "small", "--json").out)

    assert shown["definition"]["gtf"]["noisy_runs"] == 3
    assert [trial["ordinal"] for trial in shown["trials"]] == [0, 1, 2, 3]
    assert all(trial["gt_ate"] > 0 for trial in shown["trials"])


def test_trials_are_exported_as_csv_and_trajectories_as_tum(cli: Cli, room: Path, tmp_path: Path) -> None:
    cli(*CREATE, *AXIS)
    cli("study", "run", "small", "--jobs", "1")

    lines = cli("study", "export", "small", "--format", "csv").out.splitlines()
    cli("study", "export", "small", "--format", "tum", "--output", "poses")

    assert len(lines) == 5
    assert "gt_ate:room" in lines[0]
    assert len(list((tmp_path / "poses").glob("room-*.txt"))) == 4


def test_a_deleted_study_is_gone(cli: Cli, room: Path) -> None:
    cli(*CREATE, *AXIS)

    assert cli("study", "delete", "small", "--yes").code == 0
    assert json.loads(cli("study", "list", "--json").out) == []
    assert "no study yet; make one with: gtf-tune study create" in cli("study", "list").err


def test_evaluate_scores_one_setting_without_a_storage(cli: Cli, room: Path, tmp_path: Path) -> None:
    said = cli("evaluate", "room", "-p", "analytic", "-K", "3", "-j", "1", "--json")

    assert json.loads(said.out)["gtf_ate"] > 0
    assert not list(tmp_path.glob("*.db"))


def test_scores_and_true_errors_carry_the_units_that_the_definition_asks_for(cli: Cli, room: Path) -> None:
    Path("small.toml").write_text(
        'name = "small"\n[pipeline]\nname = "analytic"\n[[sequences]]\nname = "room"\npath = "room"\n'
        '[space]\n"filter.max_error" = { low = 1e-3, high = 1e-1, log = true }\n'
        '[gtf]\nclean_runs = 1\nnoisy_runs = 3\nmetric = "rpe_rotation"\n'
        '[side_metric]\nmetric = "rpe_translation"\nrpe_delta = 2\n[search]\ntrials = 2\n'
    )
    cli("study", "create", "small.toml")
    cli("study", "run", "small", "--jobs", "1")

    told = cli("study", "show", "small")
    shown = told.out
    best = cli("study", "best", "small").out
    header = cli("study", "export", "small", "--format", "csv").out.splitlines()[0]

    assert "GTF RPE" in shown
    assert "normalised" not in shown
    assert "[deg]" in shown
    assert "never seen by the search: RPE over 2 frames [GT unit]" in told.err
    assert "deg" in best
    assert "‰" not in shown + best
    assert "gt_rpe_translation:room" in header


def test_show_gives_the_noise_that_auto_has_measured(cli: Cli, room: Path) -> None:
    cli(*CREATE, *AXIS)

    before = cli("study", "show", "small").out
    cli("study", "run", "small", "--jobs", "1")
    after = cli("study", "show", "small").out

    assert "noisy (the noise is measured first)" in before
    assert re.search(r"noisy at [0-9.]+ grey levels", after)


def test_a_study_whose_runs_all_failed_has_a_report_that_says_why(cli: Cli, room: Path) -> None:
    cli(*CREATE, *AXIS, "--setting", "failure=error")
    cli("study", "run", "small", "--jobs", "1")

    said = cli("study", "report", "small")

    assert said.code == 0, said.err
    assert "runs: the analytic pipeline was told to fail" in Path("small.html").read_text(encoding="utf-8")


def test_truth_values_are_shown_as_they_are_typed_and_taken_in_any_case(cli: Cli, room: Path) -> None:
    made = cli(*CREATE, *AXIS, "-v", "refine.intrinsics=TRUE,False", "--sampler", "random")
    ran = cli("study", "run", "small", "--jobs", "1")
    shown = [cli("study", *command) for command in (("show", "small"), ("best", "small"), ("rescore", "small"))]
    table = cli("study", "export", "small", "--format", "csv")
    listed = cli("pipeline", "options", "analytic", "--grep", "refine")

    assert made.code == 0, made.err
    assert "refine.intrinsics = true  [bool]" in listed.out
    for said in (ran.err, *(one.out for one in shown), table.out, listed.out):
        assert "true" in said or "false" in said
        assert "True" not in said
        assert "False" not in said


def test_an_option_can_be_held_at_a_truth_value_in_any_case(cli: Cli, room: Path) -> None:
    made = cli(*CREATE, *AXIS, "-o", "refine.intrinsics=False")
    options = json.loads(cli("study", "show", "small", "--json").out)["definition"]["pipeline"]["options"]

    assert made.code == 0, made.err
    assert options == {"refine.intrinsics": False}


def test_trials_that_were_stopped_early_are_listed_as_done(cli: Cli, room: Path, tmp_path: Path) -> None:
    cli(*CREATE, *AXIS, "-K", "1")
    cli("study", "run", "small", "--jobs", "1")
    with contextlib.closing(sqlite3.connect(tmp_path / "gtf-tune.db", isolation_level=None)) as database:
        database.execute("UPDATE gtf_trial SET state = 'pruned' WHERE ordinal = 3")

    (row,) = cli("study", "list").out.splitlines()[1:]

    assert row.split()[2] == "4/4"


FAILING_NOMINAL = ("--setting", "failure=error", "--setting", "failure_rate=0.2", "--seed", "2", "--sampler", "random")


def test_nothing_is_compared_with_an_infeasible_nominal_trial(cli: Cli, room: Path) -> None:
    cli(*CREATE, *AXIS, *FAILING_NOMINAL, "-n", "2")
    ran = cli("study", "run", "small", "--jobs", "1").err
    cli("study", "extend", "small", "-n", "3")
    resumed = cli("study", "run", "small", "--jobs", "1").err
    watched = cli("study", "watch", "small").out
    (listed,) = json.loads(cli("study", "list", "--json").out)
    (row,) = cli("study", "list").out.splitlines()[1:]

    assert "): infeasible, the analytic pipeline was told to fail" in ran
    for said in (ran, resumed, watched):
        assert "per mille" in said
        assert " %)" not in said
    assert (listed["nominal_value"], listed["best_value"] > 0) == (None, True)
    assert row.split()[2:4] == ["3/3", "-"]


def test_folders_of_one_name_are_told_apart_by_those_above_them(cli: Cli, room: Path, tmp_path: Path) -> None:
    folders = ("first/walk/images", "second/walk/images", "first/run/images")
    for number, folder in enumerate(folders):
        write_sequence(tmp_path / folder, ground_truth=False, frames=8 + number)
    flags = [word for folder in (*folders, "room") for word in ("-s", folder)]

    cli("study", "create", "small", "-p", "analytic", *flags, *AXIS)

    stored = json.loads(cli("study", "show", "small", "--json").out)["definition"]["sequences"]
    assert [one["name"] for one in stored] == ["first-walk-images", "second-walk-images", "run-images", "room"]


def test_a_study_of_which_no_run_worked_exits_with_1_and_its_runs_can_be_tried_again(cli: Cli, room: Path) -> None:
    cli(*CREATE, *AXIS, "--setting", "failure=error")
    ran = cli("study", "run", "small", "-j", "1")
    reopened = cli("study", "retry-failed", "small")
    again = cli("study", "resume", "small", "-j", "1")

    assert ran.code == again.code == 1
    assert "every run of study 'small' failed; if this machine was at fault, correct it" in ran.err
    assert (reopened.code, reopened.err.splitlines()[-1]) == (0, "Next: gtf-tune study run small")
    assert "trials with failed runs will be tried again" in reopened.err
    assert "0 of" in again.err
    assert "0 reused" in again.err
    assert cli("storage", "check").code == 0


def test_there_is_nothing_to_retry_where_every_run_worked(cli: Cli, room: Path) -> None:
    cli(*CREATE, *AXIS)
    cli("study", "run", "small", "-j", "1")

    refused = cli("study", "retry-failed", "small")

    assert (refused.code, refused.err.splitlines()[-1]) == (
        1,
        "error: no trial of study 'small' has a failed run, so there is nothing to retry",
    )
