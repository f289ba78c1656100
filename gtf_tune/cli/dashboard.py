"""Serve optuna-dashboard on a storage, with our figures in it."""

from pathlib import Path
from typing import Annotated

import typer

from gtf_tune.cli.parameters import DEFAULT_STORAGE, Storage, hush_optuna, open_storage
from gtf_tune.cli.terminal.console import say


def dashboard(
    host: Annotated[str, typer.Option("--host", help="Address to listen on.")] = "127.0.0.1",
    port: Annotated[
        int, typer.Option("--port", min=0, max=65_535, help="Port to listen on; 0 takes any free one.")
    ] = 8080,
    artifacts: Annotated[
        Path | None, typer.Option("--artifacts", help="Folder of the attached files (default: beside a SQLite file).")
    ] = None,
    no_browser: Annotated[bool, typer.Option("--no-browser", help="Print the link only.")] = False,
    storage: Storage = DEFAULT_STORAGE,
) -> None:
    """Open optuna-dashboard on a storage; it asks for no password, so it listens on this machine only.

    Example: gtf-tune dashboard --port 8080
    """
    from gtf_tune.report.dashboard.server import serve_dashboard

    hush_optuna()
    database = open_storage(storage)
    serve_dashboard(database, host, port, artifacts=artifacts, announce=say, open_browser=not no_browser)
