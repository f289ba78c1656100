"""Where the runs of a Python program go."""

from gtf_tune.api.defaults import default_jobs
from gtf_tune.execution import LocalExecutor, StageCache, private_cache_folder


def executor_here(jobs: int | None) -> LocalExecutor:
    """Return an executor for this machine with its stage cache; by default one run for each core."""
    folder = private_cache_folder()
    return LocalExecutor(jobs or default_jobs(), StageCache(folder), scratch=folder / "scratch")
