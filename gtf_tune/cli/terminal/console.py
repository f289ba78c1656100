"""Print results on stdout, and progress and messages on stderr, whatever these streams are connected to."""

import json
import math
import re
import sys
from collections.abc import Iterable, Mapping, Sequence
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from rich.console import Console
import contextlib
import io
import os
from collections.abc import Iterator

from gtf_tune.errors import StorageError


def ready_streams() -> None:
    """Let stdout take every letter, and what goes to a closed stream vanish."""
    _fill_closed()
    if isinstance(sys.stdout, io.TextIOWrapper):  # as stderr does: a terminal of Latin-1 has no per mille sign
        sys.stdout.reconfigure(errors="backslashreplace")


@contextlib.contextmanager
def writing_results() -> Iterator[None]:
    """Bring a result to stdout whole; a reader that has seen enough (``| head``) is left to typer, which ends quietly.

    Raises
    ------
    StorageError
        Stdout takes no more, such as a file on a full disk.
    """
    try:
        yield
        sys.stdout.flush()
    except BrokenPipeError:
        raise
    except OSError as error:
        sys.stdout = open(os.devnull, "w")  # noqa: SIM115  Python flushes what is left once more at its end
        raise StorageError(f"cannot write the result to stdout ({error.strerror}); check where it goes") from error


def _fill_closed() -> None:
    """Open what the caller closed (``>&-``, some daemons), so that no other file takes its descriptor."""
    for name, mode in (("stdin", "r"), ("stdout", "w"), ("stderr", "w")):
        if getattr(sys, name) is None:
            descriptor = os.open(os.devnull, os.O_RDWR)
            os.set_inheritable(descriptor, True)
            setattr(sys, name, os.fdopen(descriptor, mode))


INTERRUPTED_EXIT_CODE = 130


def stdout() -> "Console":
    """Return the console for results; plain text where stdout is not a terminal."""
    from rich.console import Console

    return Console(file=sys.stdout, soft_wrap=False, highlight=False)


def stderr() -> "Console":
    """Return the console for progress, notes and errors."""
    from rich.console import Console

    return Console(file=sys.stderr, soft_wrap=True, highlight=False)


# What moves the cursor, renames the window or answers in the user's name, and what reverses the order of letters.
_CONTROLS = re.compile(
    r"\x1b\[[0-?]*[ -/]*[@-~]|\x1b[\]PX^_][^\x07\x1b]*(?:\x07|\x1b\\)?"
    r"|[\x00-\x08\x0b-\x1f\x7f-\x9f\u202a-\u202e\u2066-\u2069]"
)


def printable(text: str) -> str:
    """Return a text without what a terminal would obey: logs and names come from foreign programs and databases."""
    return _CONTROLS.sub("", text)


def say(text: str) -> None:
    """Print a note for people on stderr."""
    sys.stderr.write(printable(text) + "\n")


def write_line(text: str) -> None:
    """Print one line of a result on stdout, exactly as it is."""
    write_text(text + "\n")


def write_text(text: str) -> None:
    """Print a result on stdout, exactly as it is."""
    with writing_results():
        sys.stdout.write(printable(text) if sys.stdout.isatty() else text)


def write_options(options: Mapping[str, Any]) -> None:
    """Print options on stdout as NAME = VALUE, the values as they are typed."""
    from gtf_tune.pipelines.options import option_text

    for name, value in options.items():
        write_line(f"{name} = {option_text(value)}")


def write_json(value: Any) -> None:
    """Print a result as JSON on stdout; numbers that JSON lacks become null."""
    write_line(json.dumps(_jsonable(value), indent=2))


def write_table(columns: Sequence[str], rows: Iterable[Sequence[str]], title: str = "") -> None:
    """Print a table on stdout; columns whose name starts with '>' are aligned to the right."""
    from rich.table import Table

    table = Table(title=title or None, title_justify="left", box=None, pad_edge=False, header_style="bold")
    for column in columns:
        right = column.startswith(">")
        name = _plain(column.removeprefix(">"))
        table.add_column(name, justify="right" if right else "left", overflow="fold")
    for row in rows:
        table.add_row(*(_plain(cell) for cell in row))
    with writing_results():
        stdout().print(table)


def write_pairs(pairs: Mapping[str, str]) -> None:
    """Print names and values in two columns on stdout."""
    from rich.table import Table

    table = Table(box=None, pad_edge=False, show_header=False)
    table.add_column(style="bold", no_wrap=True)
    table.add_column(overflow="fold")
    for name, value in pairs.items():
        table.add_row(_plain(name), _plain(value))
    with writing_results():
        stdout().print(table)


def permille(value: float | None) -> str:
    """Format a fraction of the extent in per mille, with three significant digits."""
    from gtf_tune import display

    return display.significant(math.nan if value is None else value * 1000)


def percent(value: float | None) -> str:
    """Format a signed fraction in per cent."""
    return "-" if value is None or not math.isfinite(value) else f"{value * 100:+.1f} %"


def number(value: float | None) -> str:
    """Format a number with four significant digits."""
    return "-" if value is None or not math.isfinite(value) else f"{value:.4g}"


def duration(seconds: float) -> str:
    """Format a duration as people say it: 4.2 s, 42 s, 3 min 20 s, 5 h 12 min."""
    from gtf_tune import display

    return f"{seconds:.1f} s" if seconds < 10 else display.duration(seconds)


def _plain(text: str) -> str:
    return printable(text).replace("[", r"\[")


def _jsonable(value: Any) -> Any:
    if isinstance(value, float):
        return value if math.isfinite(value) else None
    if value is None or isinstance(value, str | int):  # most of a long result, and slow to tell from a mapping
        return value
    if isinstance(value, Mapping):
        return {str(name): _jsonable(item) for name, item in value.items()}
    if isinstance(value, list | tuple):
        return [_jsonable(item) for item in value]
    return value
