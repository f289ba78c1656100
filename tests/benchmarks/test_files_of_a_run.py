"""A newcomer who follows `study run` opens few files, and none that only draws."""

import subprocess
import sys

MOST_FILES = 100


def test_study_run_executes_few_files_and_nothing_of_the_report_without_the_dashboard() -> None:
    code = """
import sys
from benchmarks.files_of_a_run import files_of_a_run
files = files_of_a_run(["--no-dashboard"])
imported = [name for name in sys.modules if name.startswith("gtf_tune.report")]
print(len(files), imported, [name for name in files if name.startswith("report/")])
"""
    done = subprocess.run([sys.executable, "-c", code], check=True, capture_output=True, text=True)

    count, _, rest = done.stdout.strip().partition(" ")
    assert rest == "[] []"
    assert 50 < int(count) <= MOST_FILES


def test_study_run_executes_few_files_with_the_dashboard_too() -> None:
    code = "from benchmarks.files_of_a_run import files_of_a_run; print(len(files_of_a_run([])))"
    done = subprocess.run([sys.executable, "-c", code], check=True, capture_output=True, text=True)

    assert 50 < int(done.stdout) <= MOST_FILES
