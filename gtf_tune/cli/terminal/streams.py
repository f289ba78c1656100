"""Give the command line standard streams that can be written to."""

import contextlib
import io
import os
import sys
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
