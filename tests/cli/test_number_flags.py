"""Flags that take numbers refuse those that nobody means."""

import math
from collections.abc import Iterator
from typing import Any, get_args

import pytest
import typer

from gtf_tune.cli.main import app
from tests.cli.conftest import Cli

CHECKED_WITH_THE_DEFINITION = {"study create", "evaluate --noise-sigma"}
CHECKED_WITH_THE_FILES = {"metric ate --offset", "metric rpe --offset", "metric gtf --offset"}


def numbers(group: Any, path: str = "") -> Iterator[tuple[str, Any]]:
    for name, command in group.commands.items():
        if hasattr(command, "commands"):
            yield from numbers(command, f"{path}{name} ")
            continue
        for parameter in command.params:
            kinds = {parameter.type_descriptor.annotation, *get_args(parameter.type_descriptor.annotation)}
            if kinds & {int, float}:
                yield f"{path}{name} {parameter.opts[0]}", parameter


PARAMETERS = dict(numbers(typer.main.get_command(app)))


@pytest.mark.parametrize("flag", PARAMETERS)
def test_a_flag_for_a_number_has_bounds_or_is_checked_later(flag: str) -> None:
    later = CHECKED_WITH_THE_DEFINITION | CHECKED_WITH_THE_FILES
    bounds = PARAMETERS[flag].min, PARAMETERS[flag].max

    bounded = all(bound is not None and math.isfinite(bound) for bound in bounds)

    assert bounded or flag in later or flag.rpartition(" ")[0] in later


@pytest.mark.parametrize("flag", [("cache", "prune", "--limit-gb", "inf"), ("evaluate", "room", "--jobs", "9" * 30)])
def test_a_number_that_nobody_means_is_a_wrong_use(cli: Cli, flag: tuple[str, ...]) -> None:
    assert cli(*flag).code == 2
