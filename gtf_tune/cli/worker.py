"""Serve the open studies of a storage from this machine."""

import math
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from gtf_tune.cli.parameters import (
    DEFAULT_STORAGE,
    CacheDir,
    ExecutorAddress,
    Jobs,
    NoCache,
    Storage,
    default_jobs,
    hush_optuna,
    make_executor,
    storage_flag,
    wait_for_storage,
)
from gtf_tune.cli.remedies import with_remedy
from gtf_tune.cli.study.run import Places, TrialParallel, VersionMismatch, place_folders
from gtf_tune.cli.terminal.console import INTERRUPTED_EXIT_CODE, say

if TYPE_CHECKING:
    from gtf_tune.store.database import Database
    from gtf_tune.study.events import Callback, Event
    from gtf_tune.study.open_study import OpenStudy
    from gtf_tune.study.work.server import WorkerRules

Names = Annotated[list[str] | None, typer.Option("--study", metavar="NAME", help="Serve this study only; repeatable.")]
DataRoot = Annotated[
    Path | None, typer.Option("--data-root", exists=True, file_okay=False, help="Folder that holds sequences by name.")
]
Once = Annotated[bool, typer.Option("--once", help="Leave when nothing is left to do.")]
IdleExit = Annotated[
    float | None,
    typer.Option("--idle-exit", min=0.0, max=1e9, metavar="S", help="Leave after so many seconds without work."),
]


def worker(
    study: Names = None,
    data_root: DataRoot = None,
    sequence: Places = None,
    jobs: Jobs = None,
    trial_parallel: TrialParallel = 1,
    once: Once = False,
    idle_exit: IdleExit = None,
    executor: ExecutorAddress = "local",
    cache_dir: CacheDir = None,
    no_cache: NoCache = False,
    allow_version_mismatch: VersionMismatch = False,
    storage: Storage = DEFAULT_STORAGE,
) -> None:
    """Work on every open study of a storage, as one of many workers on many machines.

    Waits for new studies until it is stopped, unless --once or --idle-exit say otherwise; with --once, trials that it
    had to leave to others make it exit with 1. Ctrl-C finishes the runs in flight, twice stops at once; SIGTERM gives
    them 6 seconds. What is finished is kept, and the trial is given back.

    Example: gtf-tune worker --storage studies.db --once
    """
    from gtf_tune.errors import DefinitionError
    from gtf_tune.study.open_study import SequencePlaces
    from gtf_tune.study.runs.stop import StopRequest, signals_to
    from gtf_tune.study.work.server import WorkerLoop, WorkerRules

    if once and idle_exit is not None:
        raise DefinitionError("--once leaves as soon as nothing is left, --idle-exit S seconds later; give one of them")
    rules = WorkerRules(
        names=tuple(study or ()),
        places=SequencePlaces(place_folders(sequence), data_root.absolute() if data_root else None),
        allow_version_mismatch=allow_version_mismatch,
        trial_parallel=trial_parallel,
        idle_exit_s=0.0 if once else math.inf if idle_exit is None else idle_exit,
    )
    hush_optuna()
    stop = StopRequest()
    with (
        signals_to(stop, say),
        make_executor(jobs or default_jobs(), cache_dir, executor, no_cache=no_cache) as runs_on,
    ):
        database = wait_for_storage(storage)
        _announce_closed(database, rules)
        loop = WorkerLoop(database, runs_on, rules, stop, say, _lines, with_remedy)
        loop.run()
    if stop.level:
        say("stopped; finished runs are kept")
        raise typer.Exit(INTERRUPTED_EXIT_CODE)
    left = loop.left_to_others()
    for one in left:
        count = "the trials" if one.trials is None else f"{one.trials} trial{'s' if one.trials > 1 else ''}"
        say(f"left {count} of study '{one.name}' to other workers: {one.reason}")
    if not left:
        say("nothing is left to do")
    elif once:
        raise typer.Exit(1)


def _announce_closed(database: "Database", rules: "WorkerRules") -> None:
    """Say which of the named studies are not open; raise `StorageError` for one that is not there to be waited for."""
    from gtf_tune.store import studies

    known = studies.names(database)
    for name in rules.names:
        if name not in known and rules.idle_exit_s:
            say(f"there is no study '{name}' yet; waiting for it")
            continue
        state = studies.get(database, name).state
        if state != "open":
            say(f"study '{name}' is {state}; open it with: gtf-tune study resume {name}{storage_flag(database)}")


def _lines(study: "OpenStudy") -> "Callback":
    """Return what prints a line for each trial, since a worker's output is read in log files."""
    from gtf_tune.display import definition_unit
    from gtf_tune.study.events import summary

    unit = definition_unit(study.definition)

    def write(event: "Event") -> None:
        text = summary(event, unit)
        if text:
            say(f"{study.definition.name}: {text}")

    return write
