"""Multiply the trials of a small SQLite study, rows of every table included, without running anything."""

import sqlite3
from collections.abc import Mapping
from pathlib import Path

# What the columns of a copied row become; {c} is the number of the copy, {trials} and {runs} how many were copied.
_TRIAL, _RUN, _KEY = "{column} + {c} * {trials}", "{column} + {c} * {runs}", "lower(hex(randomblob({bytes})))"
_NEW = ""
TABLES: Mapping[str, Mapping[str, str]] = {
    "trials": {"trial_id": _TRIAL, "number": _TRIAL},
    "trial_values": {"trial_value_id": _NEW, "trial_id": _TRIAL},
    "trial_params": {"param_id": _NEW, "trial_id": _TRIAL},
    "trial_user_attributes": {"trial_user_attribute_id": _NEW, "trial_id": _TRIAL},
    "trial_system_attributes": {"trial_system_attribute_id": _NEW, "trial_id": _TRIAL},
    "trial_intermediate_values": {"trial_intermediate_value_id": _NEW, "trial_id": _TRIAL},
    "gtf_trial": {
        "id": _TRIAL,
        "ordinal": _TRIAL,
        "optuna_trial_id": _TRIAL,
        "optuna_number": _TRIAL,
        "claim": _KEY.format(bytes=16),
        "value": "{column} * (1 + 1e-6 * {c})",
    },
    "gtf_run": {"id": _RUN, "key": _KEY.format(bytes=32)},
    "gtf_run_output": {"run_id": _RUN},
    "gtf_trial_run": {"trial_id": _TRIAL, "run_id": _RUN},
    "gtf_validation": {"trial_id": _TRIAL},
}


def replicate(path: Path, copies: int) -> None:
    """Make ``copies`` times as many trials of the only study in a database; the first trials stay as they are."""
    connection = sqlite3.connect(path)
    with connection:
        trials = connection.execute("SELECT count(*) FROM gtf_trial").fetchone()[0]
        runs = connection.execute("SELECT count(*) FROM gtf_run").fetchone()[0]
        connection.execute(
            "CREATE TEMP TABLE copies AS WITH RECURSIVE counter(c) AS (SELECT 1 UNION ALL SELECT c + 1 FROM counter "
            f"WHERE c < {copies - 1}) SELECT c FROM counter"
        )
        for table, changes in TABLES.items():
            connection.execute(_statement(connection, table, changes, trials, runs))
    connection.execute("PRAGMA wal_checkpoint(TRUNCATE)")
    connection.execute("ANALYZE")
    connection.close()


def _statement(connection: sqlite3.Connection, table: str, changes: Mapping[str, str], trials: int, runs: int) -> str:
    columns = [row[1] for row in connection.execute(f"PRAGMA table_info({table})")]
    kept = [column for column in columns if changes.get(column, column) != _NEW]
    values = [
        changes.get(column, "{column}").format(column=f"t.{column}", c="copies.c", trials=trials, runs=runs)
        for column in kept
    ]
    return (
        f"INSERT INTO {table} ({', '.join(kept)}) SELECT {', '.join(values)} FROM copies, (SELECT * FROM {table}) AS t"
    )
