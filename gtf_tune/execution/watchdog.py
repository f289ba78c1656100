"""Kill a group of processes as soon as one of the watched processes is gone.

This file is run as a script by a bare interpreter (standard library only), beside each worker process. It watches the
worker and the process that owns the executor by descriptors that the kernel makes readable when they end in whatever
way, SIGKILL included. What the worker's run has started is in the worker's group and ends with it.

Usage: watchdog.py GROUP PIDFD ...
"""

import contextlib
import os
import select
import signal
import sys


def main(arguments: list[str]) -> None:
    """Wait for the end of any process in ``arguments[1:]``, then kill the group ``arguments[0]``."""
    poll = select.poll()
    for descriptor in arguments[1:]:
        poll.register(int(descriptor), select.POLLIN)
    poll.poll()
    with contextlib.suppress(ProcessLookupError):
        os.killpg(int(arguments[0]), signal.SIGKILL)


if __name__ == "__main__":
    main(sys.argv[1:])
