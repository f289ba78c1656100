"""Make the executor that the flags of a command ask for."""

import logging
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from gtf_tune.api import defaults
from gtf_tune.errors import DefinitionError

if TYPE_CHECKING:
    from gtf_tune.execution import Executor

ExecutorAddress = Annotated[
    str,
    typer.Option("--executor", metavar="local|dask://HOST:PORT", help="Where runs go: this machine or a Dask cluster."),
]

_DASK = "dask://"

cores = defaults.cores


def make_executor(jobs: int, cache_dir: Path | None, address: str = "local", *, no_cache: bool = False) -> "Executor":
    """Return an executor for this machine with the stage cache that the flags ask for, or one for a Dask cluster.

    Raises
    ------
    DefinitionError
        The address is neither ``local`` nor ``dask://HOST:PORT``.
    """
    from gtf_tune.execution import FreshStages, LocalExecutor, StageCache, default_cache_folder

    if address.startswith(_DASK):
        from gtf_tune.execution.dask.executor import DaskExecutor

        executor = DaskExecutor("tcp://" + address.removeprefix(_DASK), keep_stages=not no_cache)
        # Dask prints tracebacks when a scheduler goes away, which we say in one sentence.
        logging.getLogger("distributed").setLevel(logging.WARNING)
        logging.getLogger("distributed.client").setLevel(logging.CRITICAL)
        return executor
    if address != "local":
        raise DefinitionError(f"--executor takes local or dask://HOST:PORT, not '{address}'")
    folder = cache_dir or default_cache_folder()
    stages = FreshStages() if no_cache else StageCache(folder)
    return LocalExecutor(jobs, stages, scratch=folder / "scratch")
