"""Give the command line standard streams that can be written to."""

import contextlib
import os
import sys
from collections.abc import Iterator

from gtf_tune.errors import StorageError


def fill_closed_streams() -> None:
    """Let what goes to a closed stream (``>&-``, some daemons) vanish, and no other file take its descriptor."""
    for name, mode in (("stdin", "r"), ("stdout", "w"), ("stderr", "w")):
        if getattr(sys, name) is None:
            descriptor = os.open(os.devnull, os.O_RDWR)
            os.set_inheritable(descriptor, True)
            setattr(sys, name, os.fdopen(descriptor, mode))


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
