import json
from pathlib import Path

import pytest

from tests.cli.conftest import Cli

CREATE = (
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
    "--noise-sigma",
    "5",
)
AXIS = ("-r", "filter.max_error=1e-3:1e-1:log")


def _nominal(cli: Cli, name: str = "small") -> dict[str, object]:
    return json.loads(cli("study", "show", name, "--json").out)["definition"]["pipeline"]["nominal"]


def test_flags_and_files_give_the_baseline_of_a_study(cli: Cli, room: Path) -> None:
    Path("mine.json").write_text('{"filter": {"max_error": 0.02}, "robust": {"scale": 2.0}}')

    cli(*CREATE, *AXIS, "--nominal", "mine.json", "--nominal", "robust.scale=3", "--nominal", "robust.kernel=cauchy")

    assert _nominal(cli) == {"filter.max_error": 0.02, "robust.scale": 3.0, "robust.kernel": "cauchy"}
    shown = " ".join(cli("study", "show", "small").out.split())
    assert "nominal yours: filter.max_error=0.02, robust.kernel=cauchy, robust.scale=3" in shown


def test_what_one_study_exports_is_the_baseline_of_the_next(cli: Cli, room: Path) -> None:
    cli(*CREATE, *AXIS, "-o", "robust.kernel=cauchy")
    cli("study", "run", "small", "--jobs", "1")
    cli("study", "export", "small", "--format", "json", "--trial", "1", "-o", "mine.json")

    created = cli("study", "create", "next", *CREATE[3:], *AXIS, "--nominal", "mine.json")
    cli("study", "run", "next", "--jobs", "1")

    first = json.loads(cli("study", "show", "small", "--json").out)["trials"]
    second = json.loads(cli("study", "show", "next", "--json").out)["trials"]
    assert created.code == 0
    assert second[0]["options"] == first[1]["options"]
    assert second[0]["gtf_ate"] == first[1]["gtf_ate"]


def test_evaluate_starts_from_the_baseline(cli: Cli, room: Path) -> None:
    both = ("evaluate", "room", "-p", "analytic", "-k", "1", "-K", "2", "-j", "1", "--json")

    mine = cli(
        *both, "--nominal", "filter.max_error=0.02", "--nominal", "robust.scale=2", "-o", "filter.max_error=0.01"
    )
    by_hand = cli(*both, "-o", "filter.max_error=0.01", "-o", "robust.scale=2")

    assert json.loads(mine.out) == json.loads(by_hand.out)


@pytest.mark.parametrize(
    ("text", "reason"),
    [
        (None, "takes OPTION=VALUE or a JSON file"),
        ("{oops", "takes OPTION=VALUE or a JSON file"),
        ("[1, 2]", "should hold an object of options, not '[1, 2]'"),
        ('{"filter": {"max_eror": 1}}', "did you mean 'filter.max_error'"),
        ('{"robust": {"scale": [1]}}', "robust.scale"),
    ],
)
def test_a_file_that_holds_no_options_is_refused(cli: Cli, room: Path, text: str | None, reason: str) -> None:
    if text is not None:
        Path("mine.json").write_text(text)

    said = cli(*CREATE, *AXIS, "--nominal", "mine.json")

    assert said.code == 1
    assert reason in said.err
    assert "Traceback" not in said.err


def test_evaluate_keeps_runs_where_it_is_given_a_storage(cli: Cli, room: Path) -> None:
    command = ("evaluate", "room", "-p", "analytic", "-k", "1", "-K", "2", "-j", "1", "--noise-sigma", "5")

    first, again = (cli(*command, "--storage", "kept.db") for _ in range(2))

    assert first.out == again.out
    assert "reused" not in first.err
    assert again.err.count("frames, reused") == 3


def test_evaluate_fails_where_every_run_failed(cli: Cli, room: Path) -> None:
    command = ("evaluate", "room", "-p", "analytic", "-k", "1", "-K", "2", "-j", "1", "--noise-sigma", "5")

    assert cli(*command, "--setting", "failure=error").code == 1


@pytest.mark.real_runs
def test_evaluate_keeps_the_files_of_its_runs_where_it_is_asked_to(cli: Cli, room: Path, tmp_path: Path) -> None:
    command = ("evaluate", "room", "-p", "analytic", "-k", "1", "-K", "2", "-j", "1", "--noise-sigma", "5")

    said = cli(*command, "--keep", "files")

    assert said.code == 0, said.err
    kept = sorted(folder.name[:7] for folder in (tmp_path / "files").iterdir())
    assert kept == ["clean-0", "noisy-0", "noisy-1"]
    assert all((folder / "run.log").exists() for folder in (tmp_path / "files").iterdir())
    assert "--keep files: that folder is not empty; give a new one" in cli(*command, "--keep", "files").err


def test_the_room_that_stages_may_take_is_said_before_runs(cli: Cli, room: Path, tmp_path: Path) -> None:
    cli("study", "create", "small", "-p", "analytic", "-s", "room", "-v", "filter.max_error=0.01,0.003", "-n", "2")
    cache = ("--cache-dir", "stages", "-j", "1")

    said = [cli("study", "run", "small", *cache).err, cli("study", "confirm", "small", "--runs", "4", *cache).err]

    place = f"for stages of runs in {tmp_path / 'stages'}, where "
    assert all("disk: at most 20 GiB " in text and place in text.replace("\n", " ") for text in said)
    assert "disk:" not in cli("study", "resume", "small", *cache, "--no-cache").err
