"""The flags that several commands share."""

import os
import shlex
from contextlib import ExitStack
from typing import TYPE_CHECKING

from gtf_tune.cli.terminal.console import say

if TYPE_CHECKING:
    from gtf_tune.store.database import Database

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


Keep = Annotated[Path | None, typer.Option("--keep", metavar="DIR", help="New folder for the files of the runs.")]


def new_folder(keep: Path) -> Path:
    """Return the absolute path of a folder for files of runs, or raise `DefinitionError` where it holds something."""
    if keep.is_dir() and any(keep.iterdir()):
        raise DefinitionError(f"--keep {keep}: that folder is not empty; give a new one")
    return keep.absolute()


def make_executor(
    jobs: int, cache_dir: Path | None, address: str = "local", *, no_cache: bool = False, keep: Path | None = None
) -> "Executor":
    """Return an executor for this machine with the stage cache that the flags ask for, or one for a Dask cluster.

    ``keep`` is where a local one leaves the files of its runs.

    Raises
    ------
    DefinitionError
        The address is neither ``local`` nor ``dask://HOST:PORT``.
    """
    from gtf_tune.execution import FreshStages, LocalExecutor, StageCache, private_cache_folder

    if address.startswith(_DASK):
        from gtf_tune.execution.dask.executor import DaskExecutor

        executor = DaskExecutor("tcp://" + address.removeprefix(_DASK), keep_stages=not no_cache)
        # Dask prints tracebacks when a scheduler goes away, which we say in one sentence.
        logging.getLogger("distributed").setLevel(logging.WARNING)
        logging.getLogger("distributed.client").setLevel(logging.CRITICAL)
        return executor
    if address != "local":
        raise DefinitionError(f"--executor takes local or dask://HOST:PORT, not '{address}'")
    folder = private_cache_folder(cache_dir)
    stages = FreshStages() if no_cache else StageCache(folder)
    return LocalExecutor(jobs, stages, scratch=folder / "scratch", keep=new_folder(keep) if keep else None)


_opened = ExitStack()
_url_files: dict[str, str] = {}
"""The ``@FILE`` by which a storage was named, by the URL that is shown for it."""


def close_storages() -> None:
    """Close the connections of every storage that the command has opened."""
    _opened.close()


def open_storage(storage: str) -> "Database":
    """Open an existing storage and print which one it is."""
    from gtf_tune.store.database import open_database

    return _noted(storage, open_database(storage))


def wait_for_storage(storage: str) -> "Database":
    """Open an existing storage like `open_storage`, but wait for a server that does not answer yet."""
    from gtf_tune.store.database import wait_for_database

    return _noted(storage, wait_for_database(storage, say))


def create_storage(storage: str) -> "Database":
    """Open a storage, creating it if need be, and print which one it is."""
    from gtf_tune.store.database import create_database

    return _noted(storage, create_database(storage))


def _noted(storage: str, database: "Database") -> "Database":
    _opened.callback(database.close)
    say(f"storage: {database.shown_url}")
    if storage.startswith("@"):
        _url_files[database.shown_url] = storage
    return database


def storage_flag(database: "Database") -> str:
    """Return what a suggested command needs to find the same storage: nothing, or a blank and ``--storage URL``."""
    from gtf_tune.store.database.engine import display_url

    usual = display_url(os.environ.get(STORAGE_VARIABLE) or DEFAULT_STORAGE)
    if database.shown_url == usual:
        return ""
    return f" --storage {shlex.quote(_url_files.get(database.shown_url, database.shown_url))}"


def hush_optuna() -> None:
    """Let Optuna log warnings only; gtf-tune reports the rest itself."""
    import optuna

    optuna.logging.set_verbosity(optuna.logging.WARNING)
