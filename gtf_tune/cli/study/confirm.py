"""Confirm the best trials of a study on noise that the search never saw."""

from typing import TYPE_CHECKING, Annotated

import typer

from gtf_tune.cli.measure.runs import say_event
from gtf_tune.cli.parameters import (
    DEFAULT_STORAGE,
    CacheDir,
    Jobs,
    Json,
    Storage,
    StudyName,
    default_jobs,
    make_executor,
    open_storage,
    storage_flag,
)
from gtf_tune.cli.study.notes import say_disk, say_what_is_ahead, suggest_step
from gtf_tune.cli.study.run import (
    Dashboard,
    Places,
    VersionMismatch,
    open_for_work,
    place_folders,
)
from gtf_tune.cli.terminal.console import (
    INTERRUPTED_EXIT_CODE,
    number,
    say,
    write_json,
    write_line,
    write_pairs,
    write_table,
)

if TYPE_CHECKING:
    from gtf_tune.study.outcome.verdict import Candidate, SequenceComparison, Verdict

Top = Annotated[int, typer.Option("--top", min=1, max=1000, help="How many of the best trials, besides nominal.")]
Runs = Annotated[
    int, typer.Option("--runs", "-N", min=1, max=1000, help="Fresh noisy runs of each trial and sequence at most.")
]
Again = Annotated[bool, typer.Option("--again", help="Draw other noise than the latest confirmation did.")]


def confirm(
    name: StudyName,
    top: Top = 3,
    runs: Runs = 16,
    jobs: Jobs = None,
    again: Again = False,
    sequence: Places = None,
    cache_dir: CacheDir = None,
    allow_version_mismatch: VersionMismatch = False,
    dashboard: Dashboard = True,
    json: Json = False,
    storage: Storage = DEFAULT_STORAGE,
) -> None:
    """Run nominal and the best trials on fresh noise, and say which to adopt.

    It ends as soon as the outcome is clear. An interrupted confirmation continues where it stopped. The same one a
    second time says the same; with --again it draws other noise.

    Example: gtf-tune study confirm photos --top 3 --runs 16
    """
    from gtf_tune.study.outcome.confirm import confirm as confirm_plan
    from gtf_tune.study.outcome.confirm import plan_confirmation
    from gtf_tune.study.outcome.recommendation import recommend
    from gtf_tune.study.runs.run_source import Interrupted, RunSource, run_limits
    from gtf_tune.study.runs.stop import StopRequest, signals_to

    database = open_storage(storage)
    study = open_for_work(database, name, sequence, allow_version_mismatch)
    plan = plan_confirmation(study, place_folders(sequence), top=top, noisy_runs=runs, again=again)
    say_what_is_ahead(study, plan.num_runs, jobs or default_jobs())
    say_disk(cache_dir)
    stop = StopRequest()
    with signals_to(stop, say), make_executor(jobs or default_jobs(), cache_dir) as executor:
        source = RunSource(database, executor, run_limits(study.definition.limits), stop, say_event, study.nominal_run)
        try:
            verdict = confirm_plan(study, plan, source)
        except Interrupted:
            flags = f"--top {top} --runs {runs}{' --again' if again else ''}{storage_flag(database)}"
            say(f"stopped; the same command continues: gtf-tune study confirm {name} {flags}")
            raise typer.Exit(INTERRUPTED_EXIT_CODE) from None
    if dashboard:
        from gtf_tune.report.dashboard.sync import DashboardSync

        DashboardSync(database, name, warn=say).bring_up_to_date()
    found = recommend(database, study.record)
    if json:
        write_json({**verdict.as_json(), "recommendation": found.summary()})
        return
    _write(verdict, found.evidence.score)
    write_pairs({"verdict": found.text})
    suggest_step(found, database, study.record)


def _write(verdict: "Verdict", score: str) -> None:
    """Print what was found about each candidate, over all sequences and on each of several."""
    if not verdict.candidates:
        return
    change = (f">change of {score}", "95 % interval")
    write_table(["trial", *change, ">p (Holm)", "result"], [_line(candidate) for candidate in verdict.candidates])
    rows = [
        _sequence_line(candidate.label, name, found)
        for candidate in verdict.candidates
        if len(candidate.by_sequence) > 1
        for name, found in candidate.by_sequence.items()
    ]
    if rows:
        write_line("")
        write_table(["trial", "sequence", *change, ">p (uncorrected)"], rows)
    for candidate in verdict.candidates:
        for reason in candidate.reasons:
            write_line(f"{candidate.label}: {reason}")
    for sentence in verdict.set_aside:
        write_line(f"{sentence}.")


def _line(candidate: "Candidate") -> tuple[str, ...]:
    result = "passes" if candidate.passes else "does not pass"
    return (
        candidate.baseline or str(candidate.number),
        candidate.improvement.change,
        candidate.improvement.bounds,
        number(candidate.adjusted_p_value),
        result,
    )


def _sequence_line(label: str, name: str, found: "SequenceComparison") -> tuple[str, ...]:
    shown = f"{name} (held out)" if found.is_holdout else name
    return (
        label.removeprefix("trial "),
        shown,
        found.improvement.change,
        found.improvement.bounds,
        number(found.p_value),
    )
