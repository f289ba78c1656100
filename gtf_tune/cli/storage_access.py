"""Open the storage that a command works on, say which one it is, and keep Optuna's own notes off the terminal."""

import os
import shlex
from contextlib import ExitStack
from typing import TYPE_CHECKING

from gtf_tune.cli.parameters import DEFAULT_STORAGE, STORAGE_VARIABLE
from gtf_tune.cli.terminal.console import say

if TYPE_CHECKING:
    from gtf_tune.store.database import Database

_opened = ExitStack()
_url_files: dict[str, str] = {}
"""The ``@FILE`` by which a storage was named, by the URL that is shown for it."""


def close_storages() -> None:
    """Close the connections of every storage that the command has opened."""
    _opened.close()


def open_storage(storage: str) -> "Database":
    """Open an existing storage and print which one it is."""
    from gtf_tune.store.database import open_database

    return _noted(storage, open_database(storage))


def wait_for_storage(storage: str) -> "Database":
    """Open an existing storage like `open_storage`, but wait for a server that does not answer yet."""
    from gtf_tune.store.database import wait_for_database

    return _noted(storage, wait_for_database(storage, say))


def create_storage(storage: str) -> "Database":
    """Open a storage, creating it if need be, and print which one it is."""
    from gtf_tune.store.database import create_database

    return _noted(storage, create_database(storage))


def _noted(storage: str, database: "Database") -> "Database":
    _opened.callback(database.close)
    say(f"storage: {database.shown_url}")
    if storage.startswith("@"):
        _url_files[database.shown_url] = storage
    return database


def storage_flag(database: "Database") -> str:
    """Return what a suggested command needs to find the same storage: nothing, or a blank and ``--storage URL``."""
    from gtf_tune.store.database.engine import display_url

    usual = display_url(os.environ.get(STORAGE_VARIABLE) or DEFAULT_STORAGE)
    if database.shown_url == usual:
        return ""
    return f" --storage {shlex.quote(_url_files.get(database.shown_url, database.shown_url))}"


def hush_optuna() -> None:
    """Let Optuna log warnings only; gtf-tune reports the rest itself."""
    import optuna

    optuna.logging.set_verbosity(optuna.logging.WARNING)
