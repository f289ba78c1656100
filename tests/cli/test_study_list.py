import contextlib
import json
import sqlite3
from pathlib import Path

import pytest

from tests.cli.conftest import Cli

CREATE = ("-p", "analytic", "-s", "room", "-n", "3", "-k", "1", "-K", "4", "-r", "filter.max_error=1e-3:1e-1:log")


@pytest.fixture
def listed(cli: Cli, room: Path) -> Cli:
    """Return the command line beside a study that has run, one that has not, and one that cannot be read."""
    for name in ("done", "new", "damaged"):
        cli("study", "create", name, *CREATE)
    cli("study", "run", "done", "--jobs", "1")
    with contextlib.closing(sqlite3.connect("gtf-tune.db", isolation_level=None)) as database:
        database.execute("""UPDATE gtf_study SET definition = '{"name": "damaged"' WHERE name = 'damaged'""")
    return cli


def test_a_study_that_cannot_be_read_is_named_and_does_not_hide_the_others(listed: Cli) -> None:
    said = listed("study", "list")

    assert said.code == 0
    assert [line.split()[0] for line in said.out.splitlines()[1:]] == ["done", "new"]
    assert "not listed: study 'damaged': its stored definition is damaged" in said.err
    assert said.err.endswith("Next: gtf-tune study show new\n")


def test_the_list_as_json_names_the_trial_to_use_or_what_is_wrong(listed: Cli) -> None:
    done, new, damaged = json.loads(listed("study", "list", "--json").out)
    best = json.loads(listed("study", "best", "done", "--json").out)

    assert (done["verdict"], done["recommended"]) == (best["verdict"], best["recommended"]["ordinal"])
    assert done["best_value"] == best["recommended"]["value"]
    assert (new["verdict"], new["recommended"], new["best_value"]) == ("nothing feasible", None, None)
    assert "its stored definition is damaged" in damaged["error"]
