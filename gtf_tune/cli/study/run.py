"""Work on a study in this process."""

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
    StudyName,
    default_jobs,
    hush_optuna,
    make_executor,
    open_storage,
    storage_flag,
)
from gtf_tune.cli.study.notes import runs_of_search, say_disk, say_what_is_ahead, suggest_outcome, warn_of_lost_frames
from gtf_tune.cli.terminal.console import INTERRUPTED_EXIT_CODE, say
from gtf_tune.cli.values import split_pairs

if TYPE_CHECKING:
    from collections.abc import Sequence

    from gtf_tune.execution import Executor
    from gtf_tune.report.dashboard.sync import DashboardSync
    from gtf_tune.store.database import Database
    from gtf_tune.study.events import Callback
    from gtf_tune.study.open_study import OpenStudy

TrialParallel = Annotated[
    int,
    typer.Option(
        "--trial-parallel", min=1, max=10_000, help="Trials side by side; more than 1 changes adaptive samplers."
    ),
]
Places = Annotated[
    list[str] | None,
    typer.Option("--sequence", metavar="NAME=PATH", help="Where a sequence lies on this machine."),
]
VersionMismatch = Annotated[
    bool, typer.Option("--allow-version-mismatch", help="Go on with another version of the pipeline.")
]
Sampler = Annotated[
    str | None, typer.Option("--sampler", help="From now on another sampler: refine, tpe, qmc, random or module:Class.")
]
Dashboard = Annotated[
    bool,
    typer.Option(
        "--dashboard/--no-dashboard",
        help="Keep the notes and figures of optuna-dashboard up to date; 'gtf-tune dashboard' does so too.",
    ),
]


def run(
    name: StudyName,
    sampler: Sampler = None,
    jobs: Jobs = None,
    trial_parallel: TrialParallel = 1,
    sequence: Places = None,
    executor: ExecutorAddress = "local",
    cache_dir: CacheDir = None,
    no_cache: NoCache = False,
    allow_version_mismatch: VersionMismatch = False,
    dashboard: Dashboard = True,
    storage: Storage = DEFAULT_STORAGE,
) -> None:
    """Work on a study until its trials are done; goes on where it stopped.

    Ctrl-C once finishes the runs in flight, twice stops at once; nothing finished is lost.

    Example: gtf-tune study run photos --jobs 4
    """
    from gtf_tune.store import studies

    database = open_storage(storage)
    studies.check_open(studies.get(database, name))
    _change_sampler(database, name, sampler)
    study = open_for_work(database, name, sequence, allow_version_mismatch)
    say_what_is_ahead(study, runs_of_search(study), jobs or default_jobs())
    if executor == "local" and not no_cache:
        say_disk(cache_dir)
    work_on(
        study,
        make_executor(jobs or default_jobs(), cache_dir, executor, no_cache=no_cache),
        trial_parallel,
        dashboard=dashboard,
    )
    _suggest_next(name, database)


def resume(
    name: StudyName,
    sampler: Sampler = None,
    jobs: Jobs = None,
    trial_parallel: TrialParallel = 1,
    sequence: Places = None,
    executor: ExecutorAddress = "local",
    cache_dir: CacheDir = None,
    no_cache: NoCache = False,
    allow_version_mismatch: VersionMismatch = False,
    dashboard: Dashboard = True,
    storage: Storage = DEFAULT_STORAGE,
) -> None:
    """Go on with a study, after saying what is done and what is left.

    Example: gtf-tune study resume photos
    """
    from gtf_tune.store import runs, trials
    from gtf_tune.study.runs.plan import kept_runs
    from gtf_tune.study.states import reopen_study

    database = open_storage(storage)
    _change_sampler(database, name, sampler)
    study = open_for_work(database, name, sequence, allow_version_mismatch)
    counts = trials.counts(database, study.record.id)
    done = counts.get("complete", 0) + counts.get("pruned", 0)
    cost = runs.totals(database, study.record.id)
    say(
        f"study '{name}': {done} of {study.budget} trials done, {counts.get('claimed', 0)} in progress, "
        f"{cost.made} runs made and {cost.reused} reused for them, {study.budget - done} trials left"
    )
    kept = kept_runs(database, study.record).text
    if kept:
        say(kept)
    reopen_study(database, name)
    say_what_is_ahead(study, runs_of_search(study), jobs or default_jobs())
    if executor == "local" and not no_cache:
        say_disk(cache_dir)
    work_on(
        study,
        make_executor(jobs or default_jobs(), cache_dir, executor, no_cache=no_cache),
        trial_parallel,
        dashboard=dashboard,
    )
    _suggest_next(name, database)


def work_on(
    study: "OpenStudy",
    executor: "Executor",
    trial_parallel: int,
    *,
    dashboard: bool = True,
    also: "Sequence[Callback]" = (),
) -> None:
    """Run a study here with progress on stderr; exit with 130 if someone stopped it. Events go to ``also`` too."""
    from gtf_tune.cli.terminal.progress import StudyProgress
    from gtf_tune.study.runs.stop import STOP_NOW, StopRequest, signals_to
    from gtf_tune.study.work.worker import StudyWorker

    stop = StopRequest()
    with signals_to(stop, say), executor, StudyProgress.of(study) as progress:
        shown = _dashboard_of(study) if dashboard else None
        callbacks = [progress.on_event, *([shown.on_event] if shown else []), *also]
        done = StudyWorker(study, executor, stop, callbacks).work(trial_parallel)
        if shown and stop.level < STOP_NOW:
            shown.bring_up_to_date()
    if stop.level and not done:
        say(f"stopped; go on with: gtf-tune study resume {study.definition.name}{storage_flag(study.database)}")
        raise typer.Exit(INTERRUPTED_EXIT_CODE)


def _dashboard_of(study: "OpenStudy") -> "DashboardSync":
    from gtf_tune.report.dashboard.sync import DashboardSync

    return DashboardSync(study.database, study.definition.name, warn=say)


def open_for_work(database: "Database", name: str, places: list[str] | None, allow_mismatch: bool) -> "OpenStudy":
    """Open a study whose sequences may lie elsewhere on this machine, as the flags say."""
    from gtf_tune.study.open_study import open_study

    hush_optuna()
    study = open_study(database, name, place_folders(places), allow_version_mismatch=allow_mismatch)
    for change in study.changes:
        say(f"note: {change}")
    return study


def place_folders(places: list[str] | None) -> dict[str, Path]:
    """Return the folders of the sequences that ``--sequence NAME=PATH`` names."""
    return {name: Path(path).expanduser().absolute() for name, path in split_pairs(places, "--sequence").items()}


def _change_sampler(database: "Database", name: str, sampler: str | None) -> None:
    from gtf_tune.study.edit import change_sampler

    if sampler is not None:
        hush_optuna()
        change_sampler(database, name, sampler)


def _suggest_next(name: str, database: "Database") -> None:
    """Say what to do with a study that was worked on; exit with 1 where not a single run worked."""
    from gtf_tune.store import runs, studies

    study_id = studies.get(database, name).id
    cost = runs.totals(database, study_id)
    nothing_worked = 0 < cost.failed == cost.made + cost.reused
    if nothing_worked:
        say(
            f"every run of study '{name}' failed; if this machine was at fault, correct it, then run: gtf-tune study "
            f"retry-failed {name}{storage_flag(database)}"
        )
    warn_of_lost_frames(database, study_id)
    suggest_outcome(database, name)
    if nothing_worked:
        raise typer.Exit(1)
