"""Collect the commands that create, run and read studies."""

import typer

from gtf_tune.cli.study import best, confirm, create, delete, edit, export, listing, report, rescore, run, show, state
from gtf_tune.cli.terminal.grouping import GroupedCommands

app = typer.Typer(cls=GroupedCommands, help="Create, run and read studies.", no_args_is_help=True)
app.command("create", rich_help_panel="Work")(create.create)
app.command("run", rich_help_panel="Work")(run.run)
app.command("resume", rich_help_panel="Work")(run.resume)
app.command("confirm", rich_help_panel="Work")(confirm.confirm)
app.command("pause", rich_help_panel="Work")(state.pause)
app.command("stop", rich_help_panel="Work")(state.stop)
app.command("extend", rich_help_panel="Manage")(edit.extend)
app.command("enqueue", rich_help_panel="Manage")(edit.enqueue)
app.command("list", rich_help_panel="Look")(listing.list_studies)
app.command("show", rich_help_panel="Look")(show.show)
app.command("best", rich_help_panel="Look")(best.best)
app.command("rescore", rich_help_panel="Look")(rescore.rescore)
app.command("export", rich_help_panel="Look")(export.export)
app.command("report", rich_help_panel="Look")(report.report)
app.command("watch", rich_help_panel="Look")(report.watch)
app.command("delete", rich_help_panel="Manage")(delete.delete)
