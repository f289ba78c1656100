"""Collect the commands that create, run and read studies."""

import typer

from gtf_tune.cli import (
    study_change,
    study_confirm,
    study_create,
    study_export,
    study_read,
    study_report,
    study_run,
    study_state,
)
from gtf_tune.cli.grouping import GroupedCommands

app = typer.Typer(cls=GroupedCommands, help="Create, run and read studies.", no_args_is_help=True)
app.command("create", rich_help_panel="Work")(study_create.create)
app.command("run", rich_help_panel="Work")(study_run.run)
app.command("resume", rich_help_panel="Work")(study_run.resume)
app.command("confirm", rich_help_panel="Work")(study_confirm.confirm)
app.command("pause", rich_help_panel="Work")(study_state.pause)
app.command("stop", rich_help_panel="Work")(study_state.stop)
app.command("extend", rich_help_panel="Manage")(study_change.extend)
app.command("list", rich_help_panel="Look")(study_read.list_studies)
app.command("show", rich_help_panel="Look")(study_read.show)
app.command("best", rich_help_panel="Look")(study_read.best)
app.command("rescore", rich_help_panel="Look")(study_change.rescore)
app.command("export", rich_help_panel="Look")(study_export.export)
app.command("report", rich_help_panel="Look")(study_report.report)
app.command("watch", rich_help_panel="Look")(study_report.watch)
app.command("delete", rich_help_panel="Manage")(study_read.delete)
