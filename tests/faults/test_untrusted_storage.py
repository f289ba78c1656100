"""What a storage of strangers, or a folder of any name, may make of files and terminals."""

import os
import sqlite3
from contextlib import closing
from pathlib import Path

from gtf_tune.cli.terminal.console import printable
from gtf_tune.report.build import write_report
from gtf_tune.report.definition import ReportDefinition
from gtf_tune.store.database import Database
from tests.cli.conftest import Cli
from tests.cli.conftest import room as room
from tests.study.conftest import Runner, definition_of, write_sequence
from tests.study.conftest import database as database
from tests.study.conftest import run_study as run_study

SMALL = {"search": {"sampler": "random", "trials": 1}, "gtf": {"clean_runs": 1, "noisy_runs": 2, "noise_sigma": 5.0}}


def test_a_sequence_named_like_a_path_writes_no_file_elsewhere(
    cli: Cli, database: Database, room: Path, run_study: Runner, tmp_path: Path
) -> None:
    run_study(definition_of(room, **SMALL))
    with closing(sqlite3.connect(tmp_path / "study.db")) as connection, connection:
        connection.execute("UPDATE gtf_trial_run SET sequence_name = '../../outside/' || sequence_name")
    (tmp_path / "outside").mkdir()

    said = cli("study", "export", "small", "--format", "tum", "-o", "a/b", "--storage", str(tmp_path / "study.db"))

    assert (said.code, "'../../outside/room'" in said.err) == (1, True)
    assert not [path for path in tmp_path.rglob("*-clean-*")]


def test_a_folder_whose_name_is_no_utf_8_is_tuned_and_reported(
    database: Database, run_study: Runner, tmp_path: Path
) -> None:
    folder = write_sequence(tmp_path / "photos", ground_truth=True).rename(tmp_path / os.fsdecode(b"photos\xff"))
    run_study(definition_of(folder, **SMALL))

    write_report(tmp_path / "report.html", database, "small", ReportDefinition())

    assert "photos\\udcff" in (tmp_path / "report.html").read_text(encoding="utf-8")


def test_what_a_terminal_would_obey_is_left_out_of_notes_and_tables() -> None:
    evil = "a\x1b[31mred\x1b[0m \x1b]0;title\x07b \x1bP+q\x1b\\c\rd\x08\x9b2J \u202egpj.exe é [1/2]\tok\n"

    assert printable(evil) == "ared b cd2J gpj.exe é [1/2]\tok\n"


def test_an_error_with_escape_sequences_is_printed_without(cli: Cli) -> None:
    said = cli("study", "show", "x\x1b]0;pwned\x07y", "--storage", "no\x1b[2J.db")

    assert "\x1b" not in said.err
    assert "no.db" in said.err
