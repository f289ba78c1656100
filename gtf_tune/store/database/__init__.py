"""Reach the database: its handle, engine, tables, transactions and errors."""

from gtf_tune.store.database.handle import (
    PATIENCE_S,
    Database,
    connect,
    create_database,
    open_database,
    upgrade_database,
    wait_for_database,
)

__all__ = [
    "PATIENCE_S",
    "Database",
    "connect",
    "create_database",
    "open_database",
    "upgrade_database",
    "wait_for_database",
]
