"""Identify files by their contents."""

import hashlib
from functools import lru_cache
from pathlib import Path

from gtf_tune.errors import DefinitionError


def file_digest(path: Path) -> str:
    """Return the hex SHA-256 of a file, computed once for as long as its size and time stay.

    Raises
    ------
    DefinitionError
        The file cannot be read.
    """
    try:
        status = path.stat()
        return _digest_of(path, status.st_size, status.st_mtime_ns)
    except OSError as error:
        raise DefinitionError(
            f"{path} cannot be read ({error.strerror}), but results depend on it; correct its permissions or its path"
        ) from error


@lru_cache(maxsize=256)
def _digest_of(path: Path, size: int, modified_ns: int) -> str:
    del size, modified_ns
    with path.open("rb") as file:
        return hashlib.file_digest(file, "sha256").hexdigest()
