"""Flags that take numbers refuse those that nobody means."""

import inspect
import math
from collections.abc import Iterator
from importlib import import_module
from typing import Any, get_args

import pytest

from tests.cli.conftest import Cli
from tests.cli.test_lazy_commands import ENTRIES

CHECKED_WITH_THE_DEFINITION = {"study create", "evaluate --noise-sigma"}
CHECKED_WITH_THE_FILES = {"metric ate --offset", "metric rpe --offset", "metric gtf --offset"}


def numbers() -> Iterator[tuple[str, Any]]:
    """Yield each flag that takes a number, by the names of its command and of the flag, with what typer knows of it."""
    for name, entry in ENTRIES.items():
        module, _, function = entry.target.partition(":")
        command = getattr(import_module(f"gtf_tune.cli.{module}"), function)
        for parameter in inspect.signature(command, eval_str=True).parameters.values():
            kind, *known = get_args(parameter.annotation) or (parameter.annotation,)
            if {kind, *get_args(kind)} & {int, float}:
                flag = (getattr(known[0], "param_decls", None) or (f"--{parameter.name.replace('_', '-')}",))[0]
                yield f"{name} {flag}", known[0]


PARAMETERS = dict(numbers())


def test_there_are_flags_for_numbers() -> None:
    assert len(PARAMETERS) > 30


@pytest.mark.parametrize("flag", PARAMETERS)
def test_a_flag_for_a_number_has_bounds_or_is_checked_later(flag: str) -> None:
    later = CHECKED_WITH_THE_DEFINITION | CHECKED_WITH_THE_FILES
    bounds = PARAMETERS[flag].min, PARAMETERS[flag].max

    bounded = all(bound is not None and math.isfinite(bound) for bound in bounds)

    assert bounded or flag in later or flag.rpartition(" ")[0] in later


@pytest.mark.parametrize("flag", [("cache", "prune", "--limit-gb", "inf"), ("evaluate", "room", "--jobs", "9" * 30)])
def test_a_number_that_nobody_means_is_a_wrong_use(cli: Cli, flag: tuple[str, ...]) -> None:
    assert cli(*flag).code == 2
