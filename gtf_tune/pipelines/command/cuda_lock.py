"""Let one run at a time use a CUDA device of this machine."""

import contextlib
import os
import re
import tempfile
from collections.abc import Callable, Iterator
from pathlib import Path

from gtf_tune.operating_system import lock, open_lock_file, user_id


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
    path = Path(tempfile.gettempdir(), f"gtf-tune-{user_id()}-cuda-{device}.lock")
    descriptor = open_lock_file(path)
    try:
        with waiting():
            lock(descriptor)
        yield descriptor
    finally:
        os.close(descriptor)
