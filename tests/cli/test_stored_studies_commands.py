"""Every command that reads works on the studies of earlier commits, whatever became of their settings since."""

import json
import shutil
from pathlib import Path

import pytest

from tests.cli.conftest import Cli
from tests.study.conftest import write_sequence
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


@pytest.mark.parametrize("name", ["gp", "cmaes"])
def test_a_study_of_a_former_sampler_says_so_and_goes_on_with_another(cli: Cli, tmp_path: Path, name: str) -> None:
    shutil.copy(ASSETS / "samplers.db", tmp_path / "stored.db")
    write_sequence(tmp_path / "room", ground_truth=True)
    run = ("study", "run", name, "--sequence", "room=room", "--jobs", "1", *STORAGE)

    refused = cli(*run)
    went_on = cli(*run, "--sampler", "refine")
    shown = json.loads(cli("study", "show", name, "--json", *STORAGE).out)

    assert refused.code == 1
    assert f"error: sampler '{name}' is no longer part of gtf-tune" in refused.err
    assert "--sampler" in refused.err
    assert went_on.code == 0
    assert shown["definition"]["search"]["sampler"] == "refine"
    assert (shown["state"], len(shown["trials"])) == ("done", 5)


def test_a_worker_leaves_a_study_of_a_former_sampler_to_others(cli: Cli, tmp_path: Path) -> None:
    shutil.copy(ASSETS / "samplers.db", tmp_path / "stored.db")
    write_sequence(tmp_path / "room", ground_truth=True)

    said = cli("worker", "--once", "--study", "gp", "--sequence", "room=room", "--jobs", "1", *STORAGE)

    assert said.code == 1
    assert "study 'gp' is left to other workers: sampler 'gp' is no longer part of gtf-tune" in said.err


def test_a_grid_does_not_become_another_search(cli: Cli, tmp_path: Path) -> None:
    shutil.copy(ASSETS / "samplers.db", tmp_path / "stored.db")

    said = cli("study", "run", "grid", "--sampler", "tpe", *STORAGE)

    assert said.code == 1
    assert "cannot go on from 'grid' to 'tpe', since the trials of a grid are its points" in said.err
