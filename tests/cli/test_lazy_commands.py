"""Commands are imported when they are called, and the lists of them say what they are."""

import subprocess
import sys
from collections.abc import Iterator, Mapping
from importlib import import_module

import pytest

from gtf_tune.cli.main import COMMANDS, Entry

HEAVY = ("numpy", "optuna", "plotly", "rich", "sqlalchemy")  # typer itself imports pydantic


def leaves(entries: Mapping[str, Entry], path: str = "") -> Iterator[tuple[str, Entry]]:
    for name, entry in entries.items():
        if entry.commands is None:
            yield f"{path}{name}", entry
        else:
            yield from leaves(entry.commands, f"{path}{name} ")


ENTRIES = dict(leaves(COMMANDS))


@pytest.mark.parametrize("name", ENTRIES)
def test_the_summary_of_a_command_is_the_first_paragraph_of_its_help(name: str) -> None:
    entry = ENTRIES[name]
    module, _, function = entry.target.partition(":")
    text = getattr(import_module(f"gtf_tune.cli.{module}"), function).__doc__

    assert entry.summary == " ".join(text.partition("\n\n")[0].split()), name


@pytest.mark.parametrize("command", ["--help", "study --help", "storage --help", "sequence --help"])
def test_lists_of_commands_import_no_command_and_nothing_heavy(command: str) -> None:
    code = f"""
import sys
from gtf_tune.cli.main import main
sys.argv = ["gtf-tune", *{command.split()}]
try:
    main()
except SystemExit as end:
    assert not end.code
targets = {[f"gtf_tune.cli.{entry.target.partition(':')[0]}" for entry in ENTRIES.values()]}
print("imported", [name for name in [*{HEAVY}, *targets] if name in sys.modules])
"""
    done = subprocess.run([sys.executable, "-c", code], check=True, capture_output=True, text=True)

    assert done.stdout.splitlines()[-1] == "imported []"


def test_a_name_that_no_command_has_is_answered_with_the_nearest(cli: "object") -> None:
    said = cli("study", "shw")  # type: ignore[operator]

    assert said.code == 2
    assert "Did you mean 'show'?" in said.err
