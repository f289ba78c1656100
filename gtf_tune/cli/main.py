"""Assemble the command line and hold its only error boundary."""

import sys
from typing import Annotated

import typer

from gtf_tune.cli import cache, metric, pipeline, sequence, storage
from gtf_tune.cli.dashboard import dashboard
from gtf_tune.cli.demo import demo
from gtf_tune.cli.doctor import doctor
from gtf_tune.cli.evaluate import evaluate
from gtf_tune.cli.noise import noise
from gtf_tune.cli.remedies import with_remedy
from gtf_tune.cli.storage_access import close_storages
from gtf_tune.cli.study.app import app as study_app
from gtf_tune.cli.study.run import INTERRUPTED_EXIT_CODE
from gtf_tune.cli.terminal.console import say, write_line
from gtf_tune.cli.terminal.grouping import GroupedCommands
from gtf_tune.cli.terminal.streams import ready_streams
from gtf_tune.cli.worker import worker
from gtf_tune.errors import GtfTuneError

app = typer.Typer(
    name="gtf-tune",
    cls=GroupedCommands,
    no_args_is_help=True,
    pretty_exceptions_enable=False,
    rich_markup_mode=None,
)


def _print_version(wanted: bool) -> None:
    if wanted:
        from gtf_tune.version import __version__

        write_line(f"gtf-tune {__version__}")
        raise typer.Exit


@app.callback()
def common(
    version: Annotated[
        bool, typer.Option("--version", callback=_print_version, is_eager=True, help="Print the version and exit.")
    ] = False,
) -> None:
    """Tune Structure-from-Motion and visual SLAM without ground truth."""
    del version


app.command("demo", rich_help_panel="Start")(demo)
app.add_typer(study_app, name="study", rich_help_panel="Studies")
app.command("dashboard", rich_help_panel="Studies")(dashboard)
app.command("worker", rich_help_panel="Studies")(worker)
app.command("evaluate", rich_help_panel="Studies")(evaluate)
app.command("noise", rich_help_panel="Studies")(noise)
app.add_typer(pipeline.app, name="pipeline", rich_help_panel="Inputs")
app.add_typer(sequence.app, name="sequence", rich_help_panel="Inputs")
app.add_typer(metric.app, name="metric", rich_help_panel="Tools")
app.add_typer(storage.app, name="storage", rich_help_panel="Tools")
app.add_typer(cache.app, name="cache", rich_help_panel="Tools")
app.command("doctor", rich_help_panel="Start")(doctor)


def main() -> None:
    """Run the command line; a `GtfTuneError` becomes one sentence on stderr and exit code 1, Ctrl-C exit code 130."""
    ready_streams()
    try:
        app()
    except GtfTuneError as error:
        say(f"error: {with_remedy(error)}")
        sys.exit(1)
    except KeyboardInterrupt:  # before the command has begun, or after it; in between typer hears of it
        sys.exit(INTERRUPTED_EXIT_CODE)
    finally:
        close_storages()
