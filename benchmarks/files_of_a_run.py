"""Count the files of gtf-tune in which a function runs during ``study run``, in all threads of its process.

::

    python -m benchmarks.files_of_a_run                  # print the files, with the dashboard copy and without
    python -m benchmarks.files_of_a_run --no-dashboard   # for the second alone

The study is one of the analytic pipeline on a small sequence with ground truth, made by the command line with its
defaults. What a module does while it is imported does not count, and neither do the child processes of runs.
"""

import contextlib
import inspect
import io
import os
import sys
import tempfile
import threading
from collections.abc import Iterator
from pathlib import Path
from types import CodeType, FrameType
from typing import Any

import gtf_tune
from benchmarks.images import room
from gtf_tune.cli.main import main as command_line

PACKAGE = Path(str(gtf_tune.__file__)).parent
_INSIDE = ("<genexpr>", "<listcomp>", "<dictcomp>", "<setcomp>")  # of a function that counts, or of a module


def main() -> None:
    """Print the files and their number."""
    for flags in (["--no-dashboard"],) if "--no-dashboard" in sys.argv[1:] else ([], ["--no-dashboard"]):
        files = files_of_a_run(flags)
        sys.stdout.writelines(f"{path}\n" for path in files)
        sys.stdout.write(f"{len(files)} files of study run {' '.join(flags)}\n\n")


def files_of_a_run(flags: list[str]) -> list[str]:
    """Return the files, relative to the package, in which a function runs during ``study run`` with these flags."""
    with tempfile.TemporaryDirectory() as name, contextlib.chdir(name):
        images = room(Path(name))
        create = ("create", "photos", "-p", "analytic", "-s", str(images.root), "-n", "3", "-k", "1", "-K", "3")
        _run("study", *create, "-r", "filter.max_error=1e-3:1e-1:log")
        with functions_traced() as seen:
            _run("study", "run", "photos", "--jobs", "1", "--cache-dir", "cache", *flags)
    return sorted(str(Path(path).relative_to(PACKAGE)) for path in seen)


@contextlib.contextmanager
def functions_traced() -> Iterator[set[str]]:
    """Collect the files of the package in which a function runs, in this thread and in those that it starts."""
    root, seen = f"{PACKAGE}{os.sep}", set()

    def note(frame: FrameType, event: str, argument: Any) -> None:
        del argument
        if event == "call" and frame.f_code.co_filename.startswith(root) and _is_function(frame.f_code):
            seen.add(frame.f_code.co_filename)

    threading.setprofile(note)
    sys.setprofile(note)
    try:
        yield seen
    finally:
        sys.setprofile(None)
        threading.setprofile(None)


def _is_function(code: CodeType) -> bool:
    return bool(code.co_flags & inspect.CO_OPTIMIZED) and code.co_name not in _INSIDE


def _run(*arguments: str) -> None:
    before, sys.argv = sys.argv, ["gtf-tune", *arguments]
    said = io.StringIO()
    try:
        with contextlib.redirect_stderr(said):
            command_line()
    except SystemExit as end:
        if end.code:
            raise RuntimeError(f"gtf-tune {' '.join(arguments)} ended with {end.code}: {said.getvalue()}") from end
    finally:
        sys.argv = before


if __name__ == "__main__":
    main()
