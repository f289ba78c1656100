"""Make the executor that the flags of a command ask for."""

import os
from pathlib import Path
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from gtf_tune.execution import LocalExecutor


def make_executor(jobs: int, cache_dir: Path | None, *, no_cache: bool = False) -> "LocalExecutor":
    """Return an executor for this machine with the stage cache that the flags ask for."""
    from gtf_tune.execution import FreshStages, LocalExecutor, StageCache, default_cache_folder

    folder = cache_dir or default_cache_folder()
    stages = FreshStages() if no_cache else StageCache(folder)
    return LocalExecutor(jobs, stages, scratch=folder / "scratch")


def cores() -> int:
    """Return how many cores this process may use."""
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1
