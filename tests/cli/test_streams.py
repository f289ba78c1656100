"""Streams that are closed, full or no longer read change nothing but what is seen."""

import subprocess
import sys
from pathlib import Path

import pytest

from tests.study.conftest import write_sequence


def _redirected(arguments: str, redirection: str, folder: Path, **variables: str) -> subprocess.CompletedProcess[str]:
    command = f'exec "$0" -m gtf_tune {arguments} {redirection}'
    environment = {
        "GTF_TUNE_CACHE_DIR": str(folder / "cache"),
        "PYTHONPATH": ":".join(filter(None, sys.path)),
    } | variables
    return subprocess.run(
        ["/bin/sh", "-c", command, sys.executable],
        cwd=folder,
        env=environment,
        capture_output=True,
        text=True,
        check=False,
    )


def test_a_command_works_without_stdout(tmp_path: Path) -> None:
    done = _redirected("pipeline options analytic --json", ">&-", tmp_path)

    assert (done.returncode, done.stdout, done.stderr) == (0, "", "")


def test_runs_are_made_and_scored_without_stderr(tmp_path: Path) -> None:
    write_sequence(tmp_path / "room", ground_truth=False)

    done = _redirected("evaluate room -p analytic -k 1 -K 2 -j 1", "2>&-", tmp_path)

    assert done.returncode == 0
    assert "GTF ATE" in done.stdout


@pytest.mark.parametrize("arguments", ["pipeline list", "pipeline list --json", "pipeline options analytic"])
def test_a_result_that_finds_no_room_is_one_sentence(arguments: str, tmp_path: Path) -> None:
    done = _redirected(arguments, ">/dev/full", tmp_path)

    assert done.returncode == 1
    assert done.stderr.splitlines() == [
        "error: cannot write the result to stdout (No space left on device); check where it goes"
    ]


def test_a_reader_that_has_seen_enough_hears_no_complaint(tmp_path: Path) -> None:
    done = _redirected("pipeline options analytic --json", "| true", tmp_path)

    assert "BrokenPipeError" not in done.stderr


def test_a_letter_that_the_terminal_lacks_is_spelt_out(tmp_path: Path) -> None:
    write_sequence(tmp_path / "room", ground_truth=False)

    done = _redirected("evaluate room -p analytic -k 1 -K 2 -j 1", "", tmp_path, PYTHONIOENCODING="latin-1")

    assert done.returncode == 0
    assert r"\u2030 of extent" in done.stdout
