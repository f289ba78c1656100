"""Let one run at a time use a CUDA device of this machine."""

import contextlib
import fcntl
import os
import re
import tempfile
from collections.abc import Callable, Iterator
from pathlib import Path


def cuda_device() -> str:
    """Return the device that programs started from here use: the first of ``CUDA_VISIBLE_DEVICES``, else ``0``."""
    first = os.environ.get("CUDA_VISIBLE_DEVICES", "").split(",")[0].strip()
    return re.sub(r"[^A-Za-z0-9-]", "_", first) or "0"


@contextlib.contextmanager
def cuda_lock(
    device: str, waiting: Callable[[], contextlib.AbstractContextManager[None]] = contextlib.nullcontext
) -> Iterator[int]:
    """Wait until no other run of this user has the device, in the context that ``waiting`` opens, and hold it.

    Yields the descriptor of the lock's file. The lock lasts until the context ends *and* every process that inherited
    the descriptor is gone; the kernel frees the lock of killed processes.
    """
    path = Path(tempfile.gettempdir(), f"gtf-tune-{os.getuid()}-cuda-{device}.lock")
    descriptor = os.open(path, os.O_RDWR | os.O_CREAT, 0o600)
    try:
        with waiting():
            fcntl.flock(descriptor, fcntl.LOCK_EX)
        yield descriptor
    finally:
        os.close(descriptor)
