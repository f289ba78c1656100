"""Check, upgrade and copy storages."""

import typer

app = typer.Typer(help="Check, upgrade and copy storages.", no_args_is_help=True)
