"""Open the storage that a command works on, and say which one it is."""

from typing import TYPE_CHECKING

from gtf_tune.cli.console import say

if TYPE_CHECKING:
    from gtf_tune.store.database import Database


def open_storage(storage: str) -> "Database":
    """Open an existing storage and print which one it is."""
    from gtf_tune.store.database import open_database

    database = open_database(storage)
    say(f"storage: {database.shown_url}")
    return database


def create_storage(storage: str) -> "Database":
    """Open a storage, creating it if need be, and print which one it is."""
    from gtf_tune.store.database import create_database

    database = create_database(storage)
    say(f"storage: {database.shown_url}")
    return database
