"""Watch how much room the disks of this machine have while a run goes on."""

import os
import shutil
from collections.abc import Iterable
from pathlib import Path

_LEAST_BYTES = 64 * 2**20
_LEAST_SHARE = 0.25
_MB = 10**6


class DiskWatch:
    """The least room on some disks since the watch began.

    A run that fails because a disk is full cleans up after itself, and programs report it in a hundred ways (SQLite
    errors, SIGABRT, a message of their own), so only what was seen while it ran can show it.
    """

    def __init__(self, folders: Iterable[Path]) -> None:
        self._first = {folder: _free_bytes(folder) for folder in folders}
        self._least = dict(self._first)

    def look(self) -> None:
        """Note how much room there is now."""
        for folder, least in self._least.items():
            self._least[folder] = min(least, _free_bytes(folder))

    def shortage(self) -> str:
        """Return which disk was nearly full, as the beginning of a sentence; an empty text where none was.

        A disk was nearly full where little was left, or little beside what was taken since the watch began: what is
        written between two looks is not seen.
        """
        self.look()
        for folder, least in self._least.items():
            if least < max(_LEAST_BYTES, _LEAST_SHARE * (self._first[folder] - least)):
                return f"the disk of {folder} was nearly full, with {least / _MB:.0f} MB left"
        return ""


def _free_bytes(folder: Path) -> int:
    """Return the bytes that may still be written; 0 where no file can be made, and where the folder is gone."""
    try:
        no_file_left = hasattr(os, "statvfs") and 0 == os.statvfs(folder).f_favail < os.statvfs(folder).f_files
        return 0 if no_file_left else shutil.disk_usage(folder).free
    except OSError:
        return 0
