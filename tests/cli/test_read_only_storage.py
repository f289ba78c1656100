"""Every command that reads works on a storage that its user cannot write to."""

import json
import os
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

from tests.study.test_stored_studies import ASSETS

STUDY = "confirmed"
COMMANDS = (
    ("study", "list"),
    ("study", "show", STUDY),
    ("study", "best", STUDY),
    ("study", "report", STUDY, "-o", "report.html"),
    ("study", "export", STUDY, "--format", "csv"),
    ("study", "rescore", STUDY, "--aggregate", "mean"),
    ("storage", "check"),
    ("storage", "digest", STUDY),
)
CALL_EACH = """
import json, sys
from gtf_tune.cli.main import main
codes = []
for words in json.loads(sys.argv[1]):
    sys.argv = ["gtf-tune", *words]
    try:
        main()
        codes.append(0)
    except SystemExit as exit_:
        codes.append(exit_.code or 0)
print(json.dumps(codes))
"""


def _call_each(commands: list[list[str]], folder: Path) -> tuple[list[int], str]:
    """Return the exit codes of commands and their messages, without root's right to write where modes forbid it."""
    drop = ["setpriv", "--bounding-set=-dac_override,-dac_read_search"] if os.geteuid() == 0 else []
    if drop and not shutil.which("setpriv"):
        pytest.skip("root may write everywhere, and there is no setpriv here to give that up")
    command = [*drop, sys.executable, "-c", CALL_EACH, json.dumps(commands)]
    done = subprocess.run(command, cwd=folder, capture_output=True, text=True, check=True)
    return json.loads(done.stdout.splitlines()[-1]), done.stderr


def test_every_command_that_reads_works_where_neither_file_nor_folder_can_be_written(tmp_path: Path) -> None:
    file = tmp_path / "shared" / "stored.db"
    file.parent.mkdir()
    shutil.copy(ASSETS / "half_done.db", file)
    content = file.read_bytes()
    file.chmod(0o444)
    file.parent.chmod(0o555)
    commands = [*COMMANDS, ("study", "pause", STUDY)]

    codes, said = _call_each([[*words, "--storage", str(file)] for words in commands], tmp_path)
    file.parent.chmod(0o755)

    errors = [line for line in said.splitlines() if line.startswith("error:")]
    assert (codes, len(errors)) == ([0] * len(COMMANDS) + [1], 1), said
    assert "stored.db cannot be written to; get write permission" in errors[0]
    assert (file.read_bytes(), list(file.parent.iterdir())) == (content, [file])
