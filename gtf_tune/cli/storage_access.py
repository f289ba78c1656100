"""Open the storage that a command works on, say which one it is, and keep Optuna's own notes off the terminal."""

import os
import shlex
from contextlib import ExitStack
from typing import TYPE_CHECKING

from gtf_tune.cli.console import say
from gtf_tune.cli.parameters import DEFAULT_STORAGE, STORAGE_VARIABLE

if TYPE_CHECKING:
    from gtf_tune.store.database import Database

_opened = ExitStack()


def close_storages() -> None:
    """Close the connections of every storage that the command has opened."""
    _opened.close()


def open_storage(storage: str) -> "Database":
    """Open an existing storage and print which one it is."""
    from gtf_tune.store.database import open_database

    database = open_database(storage)
    _opened.callback(database.close)
    say(f"storage: {database.shown_url}")
    return database


def wait_for_storage(storage: str) -> "Database":
    """Open an existing storage like `open_storage`, but wait for a server that does not answer yet."""
    from gtf_tune.store.database import wait_for_database

    database = wait_for_database(storage, say)
    _opened.callback(database.close)
    say(f"storage: {database.shown_url}")
    return database


def create_storage(storage: str) -> "Database":
    """Open a storage, creating it if need be, and print which one it is."""
    from gtf_tune.store.database import create_database

    database = create_database(storage)
    _opened.callback(database.close)
    say(f"storage: {database.shown_url}")
    return database


def storage_flag(database: "Database") -> str:
    """Return what a suggested command needs to find the same storage: nothing, or a blank and ``--storage URL``."""
    from gtf_tune.store.urls import display_url

    usual = display_url(os.environ.get(STORAGE_VARIABLE) or DEFAULT_STORAGE)
    return "" if database.shown_url == usual else f" --storage {shlex.quote(database.shown_url)}"


def hush_optuna() -> None:
    """Let Optuna speak of warnings only; gtf-tune says the rest in its own words."""
    import optuna

    optuna.logging.set_verbosity(optuna.logging.WARNING)
