"""Flags of commands that score configurations without a study, and where their runs come from."""

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from gtf_tune.cli.parameters import create_storage, default_jobs, make_executor
from gtf_tune.cli.terminal.console import INTERRUPTED_EXIT_CODE, say

if TYPE_CHECKING:
    from gtf_tune.definition import GtfDefinition
    from gtf_tune.study.events import Event
    from gtf_tune.study.runs.run_source import RunSource

Images = Annotated[Path, typer.Argument(help="Folder of images.")]
Pipeline = Annotated[str, typer.Option("--pipeline", "-p", help="Pipeline.")]
Options = Annotated[list[str] | None, typer.Option("--option", "-o", metavar="NAME=VALUE", help="An option.")]
CleanRuns = Annotated[int, typer.Option("--clean-runs", "-k", min=1, max=1000, help="k.")]
NoiseSigma = Annotated[
    str, typer.Option("--noise-sigma", help="Noise in grey levels (0..255), or auto, as studies choose it.")
]
Aggregate = Annotated[str, typer.Option("--aggregate", help="mean, median, gmean or trimmed.")]
Seed = Annotated[int, typer.Option("--seed", min=0, max=2**31 - 1, help="Seed of noise and runs.")]


def score_definition(
    command: str, clean_runs: int, noisy_runs: int, noise_sigma: str, aggregate: str
) -> "GtfDefinition":
    """Return how a configuration is scored, or raise `DefinitionError` for a wrong word."""
    from gtf_tune.cli.values import parse_value
    from gtf_tune.definition import GtfDefinition
    from gtf_tune.definition.loading import section_from_dict

    given = {"clean_runs": clean_runs, "noisy_runs": noisy_runs, "aggregate": aggregate}
    return section_from_dict(GtfDefinition, {**given, "noise_sigma": parse_value(noise_sigma)}, source=command)


@contextmanager
def obtaining_runs(storage: str, jobs: int | None, cache_dir: Path | None) -> Iterator["RunSource"]:
    """Yield a source of runs that stores them; exit where someone asks to stop."""
    from gtf_tune.definition import LimitsDefinition
    from gtf_tune.study.runs.run_source import Interrupted, RunSource, run_limits
    from gtf_tune.study.runs.stop import StopRequest, signals_to

    database, stop = create_storage(storage), StopRequest()
    with signals_to(stop, say), make_executor(jobs or default_jobs(), cache_dir) as executor:
        try:
            yield RunSource(database, executor, run_limits(LimitsDefinition()), stop, say_event)
        except Interrupted:
            say("stopped; finished runs are stored, and the same command continues")
            raise typer.Exit(INTERRUPTED_EXIT_CODE) from None


def say_event(event: "Event") -> None:
    """Say on stderr which run has ended, and which noise is tried and chosen."""
    from gtf_tune.study.events import NoiseChosen, NoiseStarted, RunFinished

    match event:
        case RunFinished(run):
            note = run.stored.error or ("reused" if run.reused else f"{run.stored.wall_s:.1f} s")
            say(f"{run.request.kind} run {run.request.index} on {run.request.sequence.name}: {note}")
        case NoiseStarted() | NoiseChosen():
            say(event.text)
