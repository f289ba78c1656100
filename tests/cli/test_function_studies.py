"""What the command line does with a study that tunes the Python function of a script."""

from pathlib import Path

import pytest

import gtf_tune as gtf
from tests.cli.conftest import Cli

REASON = "tunes the Python function 'my_slam' of a script or notebook, which only that program has"


@pytest.fixture(autouse=True)
def study(cli: Cli, room: Path) -> None:
    def my_slam(images: object, options: object, seed: int) -> None:
        raise AssertionError("no other process has this function")

    my_slam.__module__, my_slam.__qualname__ = "__main__", "my_slam"
    gtf.create_study("mine", sequence=room, pipeline=my_slam, space={"a": (0.1, 1.0)}, nominal={"a": 0.5}, trials=2)


def test_a_worker_sets_it_aside_with_a_sentence(cli: Cli) -> None:
    said = cli("worker", "--once")

    assert said.code == 1
    assert f"left 2 trials of study 'mine' to other workers: study 'mine' {REASON}" in said.err


@pytest.mark.parametrize("command", ["run", "resume"])
def test_it_cannot_be_run(cli: Cli, command: str) -> None:
    said = cli("study", command, "mine")

    assert said.code == 1
    assert f"error: study 'mine' {REASON}; go on there with gtf_tune.open_study(..., pipeline=my_slam)\n" in said.err


def test_it_can_be_looked_at_and_extended(cli: Cli) -> None:
    assert "__main__:my_slam" in cli("study", "show", "mine").out
    assert "mine" in cli("study", "list").out
    assert cli("study", "extend", "mine", "-n", "5").code == 0
    assert "0/0" in cli("study", "list").out
