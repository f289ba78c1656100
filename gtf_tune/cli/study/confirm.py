"""Confirm a study's best settings on noise that the search never saw."""

from collections.abc import Mapping
from typing import TYPE_CHECKING, Annotated, Any

import typer

from gtf_tune.cli.executors import cores, make_executor
from gtf_tune.cli.parameters import DEFAULT_STORAGE, CacheDir, Jobs, Json, Storage, StudyName
from gtf_tune.cli.storage_access import open_storage, storage_flag
from gtf_tune.cli.study.notes import suggest_export, suggest_nominal_that_works, suggest_working_nominal
from gtf_tune.cli.study.run import INTERRUPTED_EXIT_CODE, Places, VersionMismatch, open_for_work, place_folders
from gtf_tune.cli.terminal.console import (
    chosen_noise,
    number,
    percent,
    say,
    tried_noise,
    write_json,
    write_line,
    write_table,
)

if TYPE_CHECKING:
    from gtf_tune.store.confirmations import Confirmation
    from gtf_tune.store.runs import StoredRun
    from gtf_tune.study.runs.run_source import RunSlot

Top = Annotated[int, typer.Option("--top", min=1, help="How many of the best settings, besides nominal.")]
Runs = Annotated[int, typer.Option("--runs", "-N", min=1, help="Fresh noisy runs of each setting and sequence.")]


def confirm(
    name: StudyName,
    top: Top = 3,
    runs: Runs = 16,
    jobs: Jobs = None,
    sequence: Places = None,
    cache_dir: CacheDir = None,
    allow_version_mismatch: VersionMismatch = False,
    json: Json = False,
    storage: Storage = DEFAULT_STORAGE,
) -> None:
    """Run nominal and the best settings on fresh noise, and say which to adopt.

    An interrupted confirmation goes on where it stopped; each further one draws noise of its own.

    Example: gtf-tune study confirm photos --top 3 --runs 16
    """
    from gtf_tune.display import definition_unit
    from gtf_tune.report.dashboard.sync import DashboardSync
    from gtf_tune.study.outcome.confirm import confirm as confirm_plan
    from gtf_tune.study.outcome.confirm import plan_confirmation
    from gtf_tune.study.outcome.verdicts import KEEP, NO_VERDICT
    from gtf_tune.study.runs.run_source import Interrupted, RunSource, run_limits
    from gtf_tune.study.runs.stop import StopRequest, signals_to

    database = open_storage(storage)
    study = open_for_work(database, name, sequence, allow_version_mismatch)
    plan = plan_confirmation(study, place_folders(sequence), top=top, noisy_runs=runs)
    stop = StopRequest()
    with signals_to(stop, say), make_executor(jobs or cores(), cache_dir) as executor:
        source = RunSource(database, executor, run_limits(study.definition.limits), stop, _Lines())
        try:
            found = confirm_plan(study, plan, source)
        except Interrupted:
            again = f"gtf-tune study confirm {name} --top {top} --runs {runs}{storage_flag(database)}"
            say(f"stopped; the same command goes on: {again}")
            raise typer.Exit(INTERRUPTED_EXIT_CODE) from None
    DashboardSync(database, name, warn=say).bring_up_to_date()
    if json:
        write_json(found.result)
        return
    _write(found, definition_unit(study.definition).name)
    if found.verdict == KEEP and not plan.nominal.feasible:
        suggest_nominal_that_works(name, storage_flag(database))
    elif found.verdict == NO_VERDICT:
        suggest_working_nominal(name, storage_flag(database))
    else:
        suggest_export(database, name, study.definition.pipeline.name)


class _Lines:
    """Say on stderr which run has ended."""

    def run_finished(self, slot: "RunSlot", run: "StoredRun", *, reused: bool) -> None:
        """Print one line."""
        note = run.error or ("reused" if reused else f"{run.wall_s:.1f} s")
        say(f"{slot.kind} run {slot.index} on {slot.sequence}: {note}")

    def noise_started(self, sequence: str, sigma: float, planned_runs: int) -> None:
        """Say which noise is tried."""
        say(tried_noise(sequence, sigma, planned_runs))

    def noise_chosen(self, sequence: str, sigma: float, reason: str) -> None:
        """Say which noise was chosen."""
        say(chosen_noise(sequence, sigma, reason))


def _write(found: "Confirmation", score: str) -> None:
    candidates = found.result["candidates"]
    columns = (f">change of {score}", "95 % interval", ">p")
    if not candidates:
        write_line(f"verdict: {found.verdict}; no setting had a better score than nominal in the search")
        return
    write_table(["trial", *columns, "verdict"], [_line(one) for one in candidates])
    several = [one for one in candidates if len(one["by_sequence"]) > 1]
    rows = [_sequence_line(one["ordinal"], *item) for one in several for item in one["by_sequence"].items()]
    if rows:
        write_line("")
        write_table(["trial", "sequence", *columns], rows)
    for one in candidates:
        for reason in one["reasons"]:
            write_line(f"trial {one['ordinal']}: {reason}")
    adopted = found.result["adopted"]
    write_line(f"verdict: {found.verdict}" + (f" trial {adopted}" if adopted is not None else ""))


def _line(one: Mapping[str, Any]) -> tuple[str, ...]:
    return str(one["ordinal"]), *_change(one), number(one["adjusted_p_value"]), one["verdict"]


def _sequence_line(trial_number: int, name: str, one: Mapping[str, Any]) -> tuple[str, ...]:
    shown = f"{name} (held out)" if one["holdout"] else name
    return str(trial_number), shown, *_change(one), number(one["p_value"])


def _change(one: Mapping[str, Any]) -> tuple[str, str]:
    if one["improvement"] is None:
        return "-", "-"
    return percent(-one["improvement"]), f"{percent(-one['high'])} to {percent(-one['low'])}"
