"""What the command line and Python take where nothing is given."""

import os

STORAGE_VARIABLE = "GTF_TUNE_STORAGE"
"""Environment variable that names the storage."""

DEFAULT_STORAGE = "gtf-tune.db"

_LEAST_BYTES_A_RUN = 2**29


def storage_or_default(storage: str | os.PathLike[str] | None) -> str:
    """Return the storage to work on: the one given, that of the environment, or a file in the current folder."""
    return os.fspath(storage) if storage else os.environ.get(STORAGE_VARIABLE) or DEFAULT_STORAGE


def cores() -> int:
    """Return how many cores this process may use."""
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1


def default_jobs() -> int:
    """Return how many runs go side by side: one a core, but no more than there is memory for."""
    from gtf_tune.operating_system import available_memory_bytes

    return max(1, min(cores(), available_memory_bytes() // _LEAST_BYTES_A_RUN))
