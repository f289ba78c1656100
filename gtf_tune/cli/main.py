"""Assemble the command line and hold its only error boundary."""

import sys

import typer

from gtf_tune.cli import cache, metric, pipeline, sequence, storage, study
from gtf_tune.cli.console import say
from gtf_tune.cli.demo import demo
from gtf_tune.cli.doctor import doctor
from gtf_tune.cli.evaluate import evaluate
from gtf_tune.errors import GtfTuneError

app = typer.Typer(
    name="gtf-tune",
    help="Tune Structure-from-Motion and visual SLAM without ground truth.",
    no_args_is_help=True,
    pretty_exceptions_enable=False,
    rich_markup_mode=None,
)
app.command("demo")(demo)
app.add_typer(study.app, name="study")
app.command("evaluate")(evaluate)
app.add_typer(pipeline.app, name="pipeline")
app.add_typer(sequence.app, name="sequence")
app.add_typer(metric.app, name="metric")
app.add_typer(storage.app, name="storage")
app.add_typer(cache.app, name="cache")
app.command("doctor")(doctor)


def main() -> None:
    """Run the command line; a `GtfTuneError` becomes one sentence on stderr and exit code 1."""
    try:
        app()
    except GtfTuneError as error:
        say(f"error: {error}")
        sys.exit(1)
