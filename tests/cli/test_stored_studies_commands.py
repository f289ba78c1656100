"""Every command that reads works on the studies of earlier commits, whatever became of their settings since."""

import json
import shutil
from pathlib import Path

import pytest

from tests.cli.conftest import Cli
from tests.study.test_stored_studies import ASSETS, FILES

STORAGE = ("--storage", "stored.db")


@pytest.mark.parametrize("file", FILES)
def test_studies_of_an_earlier_commit_are_read_by_every_command(cli: Cli, tmp_path: Path, file: str) -> None:
    shutil.copy(ASSETS / file, tmp_path / "stored.db")

    listed = json.loads(cli("study", "list", "--json", *STORAGE).out)

    assert [one["name"] for one in listed] == list(FILES[file])
    assert cli("study", "list", *STORAGE).code == 0
    for name in FILES[file]:
        for words in (
            ("show", name),
            ("best", name),
            ("rescore", name, "--aggregate", "mean"),
            ("export", name, "--format", "json"),
            ("export", name, "--format", "csv"),
            ("report", name, "-o", f"{name}.html"),
        ):
            said = cli("study", *words, *STORAGE)
            assert (said.code, "error:" in said.err) == (0, False), (words, said.err)
        assert name in (tmp_path / f"{name}.html").read_text()


def test_a_stored_confirmation_is_what_best_goes_by(cli: Cli, tmp_path: Path) -> None:
    shutil.copy(ASSETS / "half_done.db", tmp_path / "stored.db")

    best = json.loads(cli("study", "best", "confirmed", "--json", *STORAGE).out)

    assert (best["verdict"], best["recommended"]["ordinal"]) == ("adopt", 1)
