"""Check data sets, and render one."""

import typer

app = typer.Typer(help="Check data sets, take frames from videos, render a scene.", no_args_is_help=True)
