"""The flags that several commands share."""

import logging
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from gtf_tune.api import defaults
from gtf_tune.errors import DefinitionError

if TYPE_CHECKING:
    from gtf_tune.execution import Executor


STORAGE_VARIABLE = defaults.STORAGE_VARIABLE

Json = Annotated[bool, typer.Option("--json", help="Print JSON instead of a table.")]
Storage = Annotated[
    str,
    typer.Option(
        "--storage",
        envvar=STORAGE_VARIABLE,
        help="Database: a file, sqlite:///FILE, postgresql+psycopg://HOST/NAME, or @FILE that holds such a URL.",
        show_envvar=True,
    ),
]
CacheDir = Annotated[
    Path | None,
    typer.Option("--cache-dir", envvar="GTF_TUNE_CACHE_DIR", help="Folder of the stage cache.", show_envvar=True),
]
NoCache = Annotated[bool, typer.Option("--no-cache", help="Compute every stage of every run anew.")]
Jobs = Annotated[
    int | None,
    typer.Option("--jobs", "-j", min=1, max=10_000, help="Runs side by side (default: as cores and memory allow)."),
]
Settings = Annotated[
    list[str] | None,
    typer.Option("--setting", metavar="NAME=VALUE", help="A setting of the pipeline that is no option (pairing=...)."),
]
Nominal = Annotated[
    list[str] | None,
    typer.Option(
        "--nominal",
        metavar="OPTION=VALUE|FILE.json",
        help="Your present value of an option, or all of them as 'study export --format json' writes them.",
    ),
]
Frames = Annotated[
    list[str] | None,
    typer.Option(
        "--frames",
        metavar="KEY=VALUE",
        help="Which frames: start, stop, stride, rate_hz, max_frames; max_image_size for their size.",
    ),
]
StudyName = Annotated[str, typer.Argument(metavar="STUDY", help="Name of the study.")]

DEFAULT_STORAGE = defaults.DEFAULT_STORAGE


ExecutorAddress = Annotated[
    str,
    typer.Option("--executor", metavar="local|dask://HOST:PORT", help="Where runs go: this machine or a Dask cluster."),
]

_DASK = "dask://"

default_jobs = defaults.default_jobs


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
