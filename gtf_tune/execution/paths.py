"""The files of runs, and the removal of what a killed process left."""

import contextlib
import itertools
import os
import shutil
import tempfile
from dataclasses import dataclass
from pathlib import Path
from typing import IO

import platformdirs

from gtf_tune.errors import MachineError
from gtf_tune.operating_system import lock, make_private, try_lock

_LOG_TAIL_BYTES = 8192
_OWNER_LOCK = "owner.lock"


@dataclass(frozen=True)
class RunPaths:
    """The files of one run, below its own folder."""

    folder: Path

    @property
    def log(self) -> Path:
        """Return the file that receives everything the run prints."""
        return self.folder / "run.log"

    @property
    def phase(self) -> Path:
        """Return the file in which the run notes what it is doing (see `run_timer`)."""
        return self.folder / "phase"

    @property
    def workspace(self) -> Path:
        """Return the folder that the pipeline may write to."""
        return self.folder / "workspace"

    def create(self) -> None:
        """Make the folder and an empty workspace."""
        self.workspace.mkdir(parents=True, exist_ok=True)

    def remove(self) -> None:
        """Delete everything that the run has written."""
        shutil.rmtree(self.folder, ignore_errors=True)

    def keep(self, place: Path, name: str) -> None:
        """Move all files to a new folder of ``place``; a second one of that name gets a number."""
        with contextlib.suppress(OSError):  # a full disk there costs no run
            place.mkdir(parents=True, exist_ok=True)
            numbers = itertools.count(2)
            target = place / name
            while target.exists():
                target = place / f"{name}-{next(numbers)}"
            shutil.move(self.folder, target)

    def read_log_tail(self) -> str:
        """Return the last 8 KiB of the log, or an empty text where there is none."""
        try:
            with self.log.open("rb") as file:
                file.seek(0, os.SEEK_END)
                file.seek(max(0, file.tell() - _LOG_TAIL_BYTES))
                return file.read().decode(errors="replace").replace("\x00", "")
        except OSError:
            return ""


class Scratch:
    """A folder for the runs of one executor, which disappears with the executor.

    The owner holds a lock on a file inside. The next owner removes the folders of owners that were killed: their locks
    are free.
    """

    def __init__(self, root: Path) -> None:
        root = root.expanduser().absolute()  # programs start in folders of their own
        try:
            make_private(root)
            with (root / "turn.lock").open("ab") as turn:
                # Between a folder and its lock, another owner would take it for abandoned (1 of 100 of eight at once).
                lock(turn)
                _remove_abandoned(root)
                self.folder = Path(tempfile.mkdtemp(prefix="runs-", dir=root))
                self._lock: IO[bytes] = (self.folder / _OWNER_LOCK).open("wb")
                lock(self._lock)
        except OSError as error:
            raise _unwritable(root, error) from error

    def paths(self, name: str) -> RunPaths:
        """Return the paths of a new run, whose folders are there.

        Raises
        ------
        MachineError
            They cannot be made.
        """
        try:
            paths = RunPaths(Path(tempfile.mkdtemp(prefix=f"{name}-", dir=self.folder)))
            paths.create()
        except OSError as error:
            raise _unwritable(self.folder, error) from error
        return paths

    def close(self) -> None:
        """Delete the folder."""
        shutil.rmtree(self.folder, ignore_errors=True)
        self._lock.close()


def default_cache_folder() -> Path:
    """Return the absolute folder of the stage cache: ``GTF_TUNE_CACHE_DIR``, else the platform's place for caches."""
    chosen = os.environ.get("GTF_TUNE_CACHE_DIR")
    return Path(chosen or platformdirs.user_cache_dir("gtf-tune")).expanduser().absolute()


def private_cache_folder(chosen: Path | None = None) -> Path:
    """Return the folder of the stage cache after making it for this user alone; the default where none was chosen.

    Raises
    ------
    MachineError
        It cannot be made, or belongs to another user.
    """
    folder = chosen.expanduser().absolute() if chosen else default_cache_folder()
    try:
        return make_private(folder)
    except OSError as error:
        raise _unwritable(folder, error) from error


def _unwritable(folder: Path, error: OSError) -> MachineError:
    return MachineError(
        f"cannot write below {folder} ({error.strerror}); choose another folder for the cache", remedy=("cache folder",)
    )


def _remove_abandoned(root: Path) -> None:
    for folder in root.glob("runs-*"):
        try:
            with (folder / _OWNER_LOCK).open("ab") as owner:
                abandoned = try_lock(owner)
        except OSError:
            continue
        if abandoned:
            shutil.rmtree(folder, ignore_errors=True)
