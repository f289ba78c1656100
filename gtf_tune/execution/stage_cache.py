"""Keep the results of stages on disk, shared by all studies and processes of a machine.

An entry is a folder named by the stage's key. It is built aside and renamed into place, so it is whole or absent; a
manifest with the checksum of every file is verified on each read, and a damaged entry is dropped and built again. A
lock file per key makes a second process wait for the first instead of building the same thing, and protects an entry
from eviction while a run uses it; the kernel frees the locks of killed processes.
"""

import contextlib
import json
import os
import shutil
import tempfile
import zlib
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from pathlib import Path
from typing import IO

from gtf_tune.errors import MachineError
from gtf_tune.operating_system import lock as take_lock
from gtf_tune.operating_system import make_private, try_lock

_MANIFEST = "manifest.json"
_CHUNK_BYTES = 2**20
DEFAULT_LIMIT_BYTES = 20 * 2**30


@dataclass(frozen=True)
class CacheInfo:
    """What a stage cache holds: entries and bytes by stage, and the size limit."""

    folder: Path
    limit_bytes: int
    entries: dict[str, int]
    bytes: dict[str, int]


@dataclass(frozen=True)
class _Entry:
    folder: Path
    stage: str
    bytes: int
    used_at: float


@dataclass(frozen=True)
class StageCache:
    """Stages in ``folder``, up to ``limit_bytes``; the least recently used entries go first."""

    folder: Path
    limit_bytes: int = DEFAULT_LIMIT_BYTES

    def __post_init__(self) -> None:
        # Programs start in folders of their own, where a relative path would name another place.
        object.__setattr__(self, "folder", self.folder.expanduser().absolute())

    @contextlib.contextmanager
    def open(self, workspace: Path) -> Iterator["_CachedStages"]:
        """Yield the stages of one run; entries that it has reached are not evicted until the context ends."""
        del workspace
        stages = _CachedStages(self)
        try:
            yield stages
        finally:
            stages.release()

    def info(self) -> CacheInfo:
        """Count the entries and bytes of every stage."""
        entries: dict[str, int] = {}
        sizes: dict[str, int] = {}
        for entry in self._entries():
            entries[entry.stage] = entries.get(entry.stage, 0) + 1
            sizes[entry.stage] = sizes.get(entry.stage, 0) + entry.bytes
        return CacheInfo(self.folder, self.limit_bytes, entries, sizes)

    def prune(self, limit_bytes: int | None = None) -> int:
        """Drop least recently used entries until the rest fits in the limit, and return the bytes freed."""
        limit = self.limit_bytes if limit_bytes is None else limit_bytes
        entries = sorted(self._entries(), key=lambda entry: entry.used_at)
        excess = sum(entry.bytes for entry in entries) - limit
        freed = 0
        for entry in entries:
            if freed >= excess:
                break
            freed += entry.bytes if self._remove_unused(entry.folder.name, entry.folder) else 0
        self._remove_abandoned()
        return freed

    def clear(self) -> int:
        """Drop every entry that no run uses, and return the bytes freed."""
        return self.prune(limit_bytes=0)

    def make_room(self) -> None:
        """Drop every entry that no run uses, because the disk is full."""
        self.clear()

    def entry_folder(self, key: str) -> Path:
        """Return the folder of a key, whether it exists or not."""
        return self.folder / "stages" / key[:2] / key

    def lock(self, key: str) -> IO[bytes]:
        """Return the open lock file of a key."""
        path = self.folder / "locks" / key
        make_private(self.folder)
        make_private(path.parent)
        return path.open("ab")

    def build(self, stage: str, key: str, build: Callable[[Path], None]) -> None:
        """Build an entry aside and rename it into place; the caller holds the lock of the key alone."""
        final = self.entry_folder(key)
        for folder in (self.folder / "stages", final.parent, self.folder / "building"):
            make_private(folder)
        for abandoned in (self.folder / "building").glob(f"{key}-*"):
            shutil.rmtree(abandoned, ignore_errors=True)
        aside = Path(tempfile.mkdtemp(prefix=f"{key}-", dir=self.folder / "building"))
        try:
            (aside / "files").mkdir()
            build(aside / "files")
            _write_manifest(aside, stage)
            aside.rename(final)
        finally:
            shutil.rmtree(aside, ignore_errors=True)
        self.prune()

    def _entries(self) -> Iterator[_Entry]:
        for manifest in (self.folder / "stages").glob(f"*/*/{_MANIFEST}"):
            with contextlib.suppress(OSError, ValueError, KeyError):
                content = json.loads(manifest.read_text(encoding="utf-8"))
                size = sum(file["bytes"] for file in content["files"].values())
                yield _Entry(manifest.parent, content["stage"], size, manifest.stat().st_mtime)

    def _remove_unused(self, key: str, folder: Path) -> bool:
        """Remove the folder of a key, unless someone uses or builds its entry, and return whether it is gone."""
        with self.lock(key) as lock:
            if not try_lock(lock):
                return False
            _remove_entry(folder)
            return True

    def _remove_abandoned(self) -> None:
        # Whoever builds holds the lock. Its process says nothing: that of another container is not seen from here.
        for folder in (self.folder / "building").glob("*-*"):
            self._remove_unused(folder.name.rpartition("-")[0], folder)


@dataclass
class _CachedStages:
    """The stages of one run, taken from a cache."""

    cache: StageCache
    locks: dict[str, IO[bytes]] = field(default_factory=dict)

    def reach(self, stage: str, key: str, build: Callable[[Path], None]) -> Path:
        """Return the folder of a stage's files, building it if no sound copy is at hand."""
        folder = self.cache.entry_folder(key)
        if key in self.locks:
            return folder / "files"
        try:
            lock = self.cache.lock(key)
        except OSError as error:
            raise MachineError(
                f"the stage cache {self.cache.folder} cannot be written ({error.strerror}); choose another folder for "
                "it, or work without it",
                remedy=("cache",),
            ) from error
        try:
            take_lock(lock, shared=True)
            if not _is_sound(folder):
                self._build_alone(lock, stage, key, build)
            os.utime(folder / _MANIFEST)
        except BaseException:
            lock.close()
            raise
        self.locks[key] = lock
        return folder / "files"

    def release(self) -> None:
        """Let go of every entry."""
        for lock in self.locks.values():
            lock.close()
        self.locks.clear()

    def _build_alone(self, lock: IO[bytes], stage: str, key: str, build: Callable[[Path], None]) -> None:
        take_lock(lock)
        folder = self.cache.entry_folder(key)
        if not _is_sound(folder):
            _remove_entry(folder)
            self.cache.build(stage, key, build)
        take_lock(lock, shared=True)


def _write_manifest(folder: Path, stage: str) -> None:
    files = {
        str(path.relative_to(folder / "files")): {"bytes": path.stat().st_size, "crc32": _checksum(path)}
        for path in sorted((folder / "files").rglob("*"))
        if path.is_file()
    }
    (folder / _MANIFEST).write_text(json.dumps({"stage": stage, "files": files}), encoding="utf-8")


def _is_sound(folder: Path) -> bool:
    try:
        content = json.loads((folder / _MANIFEST).read_text(encoding="utf-8"))
        return all(
            (folder / "files" / name).stat().st_size == file["bytes"]
            and _checksum(folder / "files" / name) == file["crc32"]
            for name, file in content["files"].items()
        )
    except (OSError, ValueError, KeyError, TypeError):
        return False


def _checksum(path: Path) -> int:
    value = 0
    with path.open("rb") as file:
        while chunk := file.read(_CHUNK_BYTES):
            value = zlib.crc32(chunk, value)
    return value


def _remove_entry(folder: Path) -> None:
    # The manifest goes first: an entry whose removal is interrupted is damaged, never half right.
    (folder / _MANIFEST).unlink(missing_ok=True)
    shutil.rmtree(folder, ignore_errors=True)
