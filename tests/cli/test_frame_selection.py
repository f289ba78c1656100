import json
from pathlib import Path

import pytest

from tests.cli.conftest import Cli


def test_inspect_takes_the_selection_of_the_paper(cli: Cli, room: Path) -> None:
    found = json.loads(
        cli("sequence", "inspect", "room", "--frames", "stride=2", "--frames", "max_frames=3", "--json").out
    )

    assert found["frames"] == 3


def test_a_study_keeps_the_selection(cli: Cli, room: Path) -> None:
    created = cli(
        *("study", "create", "chosen", "-s", "room", "-p", "analytic", "-r", "robust.scale=0.1:10:log"),
        *("--frames", "max_frames=4", "--trials", "2"),
    )
    shown = json.loads(cli("study", "show", "chosen", "--json").out)

    assert created.code == 0
    assert shown["definition"]["sequences"][0]["max_frames"] == 4


def test_evaluate_scores_the_chosen_frames(cli: Cli, room: Path) -> None:
    command = ("evaluate", "room", "-p", "analytic", "-k", "1", "-K", "2", "-j", "1", "--json")

    chosen = json.loads(cli(*command, "--frames", "max_frames=5").out)
    everything = json.loads(cli(*command).out)

    assert chosen["coverage"] == everything["coverage"] == 1.0
    assert chosen["gtf_ate"] != everything["gtf_ate"]


@pytest.mark.parametrize(
    ("given", "said"),
    [("frames=3", "knows start"), ("stride=often", "takes a number"), ("stride", "KEY=VALUE|NAME=VALUE")],
)
def test_a_wrong_selection_is_one_sentence(cli: Cli, room: Path, given: str, said: str) -> None:
    refused = cli("sequence", "inspect", "room", "--frames", given)

    assert refused.code == 1
    assert any(part in refused.err for part in said.split("|"))


@pytest.mark.parametrize(
    "command",
    [
        ("study", "create", "few", "-s", "room", "-p", "analytic", "-r", "robust.scale=0.1:10:log"),
        ("evaluate", "room", "-p", "analytic", "-j", "1"),
        ("noise", "room", "-p", "analytic", "-j", "1"),
    ],
)
def test_too_few_frames_are_refused_before_any_run(cli: Cli, room: Path, command: tuple[str, ...]) -> None:
    refused = cli(*command, "--frames", "start=10", "--frames", "stop=11")

    assert refused.code == 1
    assert refused.err.splitlines()[-1] == (
        f"error: {room}: the selection leaves 1 of the 12 frames, at least 4 are needed; change start, stop, stride, "
        "rate_hz, max_frames or exclude"
    )


def test_a_study_of_too_few_frames_is_not_suggested(cli: Cli, room: Path) -> None:
    few = cli("sequence", "inspect", "room", "--frames", "max_frames=3")
    enough = cli("sequence", "inspect", "room", "--frames", "max_frames=4")

    assert "study create" not in few.err
    assert "Next: gtf-tune study create room" in enough.err
