"""A command that only reads a study must not wait for what only work on one needs."""

import subprocess
import sys
from pathlib import Path

from tests.cli.conftest import Cli
from tests.cli.test_study_commands import AXIS, CREATE

# Each takes about as long to import as a study of 10,000 trials takes to be listed, or longer.
HEAVY = ("alembic", "cv2", "numpy", "optuna", "plotly", "pycolmap", "scipy")
READING = (
    ("list",),
    ("show", "small"),
    ("show", "small", "--json"),
    ("best", "small"),
    ("best", "small", "--json"),
    ("export", "small", "--format", "csv"),
    ("export", "small", "--format", "json"),
)
_WATCH = f"""
import sys
from gtf_tune.cli.main import main
for command in {READING}:
    sys.argv = ["gtf-tune", "study", *command]
    try:
        main()
    except SystemExit as end:
        if end.code:
            raise
    found = [name for name in {HEAVY} if name in sys.modules]
    if found:
        sys.exit(f"{{' '.join(command)}} has imported {{', '.join(found)}}")
"""


def test_reading_commands_import_nothing_heavy(cli: Cli, room: Path) -> None:
    cli(*CREATE, *AXIS)
    cli("study", "run", "small", "--jobs", "1")

    done = subprocess.run([sys.executable, "-c", _WATCH], check=False, capture_output=True, text=True)

    assert done.returncode == 0, done.stderr
