"""Copy a SQLite file while others may write to it."""

import itertools
import sqlite3
from contextlib import closing
from pathlib import Path

from gtf_tune.errors import StorageError


def back_up(path: Path) -> Path:
    """Copy a SQLite file beside itself, under a name that is free, and return the path of the copy.

    Raises
    ------
    StorageError
        The copy cannot be written.
    """
    names = (path.with_name(f"{path.name}.backup-{number}") for number in itertools.count(1))
    copy = next(name for name in names if not name.exists())
    try:
        with closing(sqlite3.connect(path)) as source, closing(sqlite3.connect(copy)) as target:
            source.backup(target)
    except sqlite3.Error as error:
        copy.unlink(missing_ok=True)
        raise StorageError(
            f"{path} cannot be copied to {copy} before its upgrade ({error}); free some space there, or make a backup "
            "elsewhere and upgrade that"
        ) from error
    return copy
