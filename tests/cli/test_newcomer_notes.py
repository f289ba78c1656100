import contextlib
import csv
import json
import shlex
import shutil
import sqlite3
from pathlib import Path

import pytest

import gtf_tune
from tests.cli.conftest import Cli

CREATE = ("study", "create", "small", "-p", "analytic", "-s", "room", "-n", "3", "-k", "1", "-K", "3")
AXIS = ("-r", "filter.max_error=1e-3:1e-1:log")


def test_a_sound_study_is_read_without_warnings(cli: Cli, room: Path) -> None:
    cli(*CREATE, *AXIS)

    said = [
        cli("study", *command).err for command in (("run", "small", "-j", "1"), ("show", "small"), ("best", "small"))
    ]

    assert not any("warning" in text for text in said)


def test_frames_that_nominal_loses_are_warned_of(cli: Cli, room: Path) -> None:
    cli(*CREATE, *AXIS, "-o", "matching.max_ratio=0.3")
    cli("study", "run", "small", "-j", "1")

    assert "warning: on room the nominal options register only" in cli("study", "show", "small").err


@pytest.mark.real_runs
def test_a_nominal_setting_that_fails_is_warned_of_with_the_reason(cli: Cli, room: Path) -> None:
    cli(*CREATE, *AXIS, "--setting", "failure=abort")
    cli("study", "run", "small", "-j", "1")

    said = cli("study", "show", "small").err

    assert "warning: on room the nominal options give no trajectory: " in said
    assert "registers only" not in said


def test_frames_that_noise_costs_are_told_apart_from_those_missing_anyway(cli: Cli, room: Path, tmp_path: Path) -> None:
    cli(*CREATE, *AXIS)
    cli("study", "run", "small", "-j", "1")
    with contextlib.closing(sqlite3.connect(tmp_path / "gtf-tune.db", isolation_level=None)) as database:
        database.execute(
            "UPDATE gtf_trial SET detail = json_set(detail, '$.sequences.room.coverage_noisy', json('[1, 0.4, 0.4]')) "
            "WHERE ordinal = 0"
        )

    said = cli("study", "best", "small")

    assert "noise costs the nominal options frames (100% without it, 40% in the median noisy run)" in said.err
    assert "registers only" not in said.err
    assert "Keep the nominal options" in said.out
    assert "why      The score says little on room" in said.out
    assert "--noise-sigma" in said.err


def test_trials_of_another_version_say_so_and_a_pick_among_them_is_warned_of(
    cli: Cli, room: Path, tmp_path: Path
) -> None:
    cli(*CREATE, *AXIS)
    cli("study", "run", "small", "-j", "1")
    pick = json.loads(cli("study", "best", "small", "--json").out)["best"]["ordinal"]
    _note_version(tmp_path, pick)

    best = cli("study", "best", "small").err
    shown = json.loads(cli("study", "show", "small", "--json").out)["trials"]
    rows = list(csv.DictReader(cli("study", "export", "small", "--format", "csv").out.splitlines()))

    assert pick > 0
    assert f"warning: nominal and trial {pick} were made by different versions of the pipeline" in best
    assert f"the worker of trial {pick} noted that the study began with analytic 0" in best
    expected = {0: None, 1: None, 2: None, pick: "began with analytic 0, but 1 is installed here"}
    assert {one["ordinal"]: one["version_mismatch"] for one in shown} == expected
    assert {int(one["ordinal"]): one["version_mismatch"] or None for one in rows} == expected


def test_a_pick_of_the_version_of_nominal_is_not_warned_of(cli: Cli, room: Path, tmp_path: Path) -> None:
    cli(*CREATE, *AXIS)
    cli("study", "run", "small", "-j", "1")
    for number in range(3):
        _note_version(tmp_path, number)

    assert "different versions" not in cli("study", "best", "small").err


def _note_version(folder: Path, number: int) -> None:
    with contextlib.closing(sqlite3.connect(folder / "gtf-tune.db", isolation_level=None)) as database:
        database.execute(
            "UPDATE gtf_trial SET detail = json_set(detail, '$.version_mismatch', "
            "'began with analytic 0, but 1 is installed here') WHERE ordinal = ?",
            (number,),
        )


def test_images_are_shrunk_on_request(cli: Cli, room: Path) -> None:
    cli(*CREATE, *AXIS, "--max-image-size", "16")

    assert '"max_image_size": 16' in cli("study", "show", "small", "--json").out


def test_suggested_commands_find_the_same_storage(cli: Cli, room: Path) -> None:
    created = cli(*CREATE, *AXIS, "--storage", "other place.db")
    paused = cli("study", "pause", "small", "--storage", "other place.db")

    assert "Next: gtf-tune study run small --storage 'sqlite:///other place.db'" in created.err
    assert "Next: gtf-tune study resume small --storage 'sqlite:///other place.db'" in paused.err


def test_a_storage_named_by_a_file_is_suggested_by_that_file(cli: Cli, room: Path, tmp_path: Path) -> None:
    (tmp_path / "url").write_text("sqlite:///secret.db\n")

    created = cli(*CREATE, *AXIS, "--storage", "@url")

    assert "Next: gtf-tune study run small --storage @url\n" in created.err


def test_the_storage_of_the_environment_is_not_repeated(cli: Cli, room: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("GTF_TUNE_STORAGE", "usual.db")

    assert "Next: gtf-tune study run small\n" in cli(*CREATE, *AXIS).err


def test_a_finished_study_without_a_feasible_trial_says_why_instead_of_asking_to_run_it(cli: Cli, room: Path) -> None:
    cli(*CREATE, *AXIS, "--setting", "failure=error")
    begun = cli("study", "best", "small")
    ran = cli("study", "run", "small", "-j", "1")
    asked = [cli("study", *command, "small") for command in (("best",), ("export", "-f", "json"), ("confirm",))]
    shown = cli("study", "show", "small")

    assert "has no feasible trial yet; run it first (gtf-tune study run small)" in begun.err
    assert ran.err.endswith("Next: gtf-tune study show small\n")
    for said in asked:
        assert (said.code, said.err.splitlines()[-1]) == (
            1,
            "error: no trial of study 'small' is feasible: the analytic pipeline was told to fail; look at its trials "
            "(gtf-tune study show small)",
        )
    assert shown.err.endswith("Next: gtf-tune study report small\n")


def test_a_study_that_has_not_begun_is_suggested_to_be_run(cli: Cli, room: Path) -> None:
    cli(*CREATE, *AXIS)
    created = cli("study", "show", "small")
    cli("study", "pause", "small")
    paused = cli("study", "show", "small")
    cli("study", "resume", "small", "-j", "1")
    done = cli("study", "show", "small")

    assert created.err.endswith("Next: gtf-tune study run small\n")
    assert paused.err.endswith("Next: gtf-tune study resume small\n")
    assert done.err.endswith("Next: gtf-tune study best small\n")


def test_what_follows_the_inspection_of_a_folder_of_any_name_can_be_called(cli: Cli, room: Path) -> None:
    room.rename(room.with_name("my photos é"))
    said = cli("sequence", "inspect", "my photos é", "--frames", "max_frames=6").err
    words = shlex.split(said.partition("Next: gtf-tune ")[2])

    assert cli(*words).code == 0
    assert words[:3] == ["study", "create", "my-photos"]
    assert "max_frames=6" in words


def test_the_version_is_told(cli: Cli) -> None:
    assert cli("--version").out == f"gtf-tune {gtf_tune.__version__}\n"


def test_creating_a_study_says_what_is_odd_about_its_images(cli: Cli, room: Path) -> None:
    (room / "poses_gps.txt").write_text("1 2 3\n")

    said = cli(*CREATE, *AXIS).err

    assert "note: files that may describe camera or poses and are not read: poses_gps.txt\n" in said


def test_creating_a_study_says_of_which_sequence_it_is_and_that_intrinsics_are_unknown(
    cli: Cli, room: Path, tmp_path: Path
) -> None:
    other = tmp_path / "plain"
    shutil.copytree(room / "rgb", other)
    (other / "000000.png").unlink()

    said = cli(*CREATE, *AXIS, "-s", "plain").err

    assert "note: sequence 'plain': intrinsics are unknown; the pipeline estimates them\n" in said
    assert "note: sequence 'room': intrinsics are unknown; the pipeline estimates them\n" in said
