"""What only some operating systems offer, each with what stands in for it elsewhere.

No other module imports ``fcntl`` or ``resource``, reads ``/proc``, or asks for users, sessions and signals that Windows
lacks; the two scripts that run without packages, ``watchdog.py`` and ``supervisor.py``, are the exception.
"""

import contextlib
import os
import signal
import socket
import stat
import sys
import uuid
from collections.abc import Iterator
from multiprocessing import resource_tracker
from pathlib import Path
from typing import IO, Any

import psutil

from gtf_tune.errors import MachineError

fcntl: Any
msvcrt: Any
resource: Any
try:
    import fcntl
    import resource
except ImportError:  # Windows
    fcntl = resource = None
try:
    import msvcrt
except ImportError:
    msvcrt = None

SIGKILL = getattr(signal, "SIGKILL", signal.SIGTERM)
SIGNALS_FROM_OUTSIDE = tuple(getattr(signal, name) for name in ("SIGTERM", "SIGHUP", "SIGINT") if hasattr(signal, name))
"""By which people, terminals and schedulers end processes."""

_PROC = Path("/proc")
_DEAD_STATES = frozenset("ZXx")
_STATE_FIELD = 0
_START_FIELD = 19
_KIB = 1024
_MIB = 2**20


# Locks on files: the kernel frees those of a killed process.


def lock(file: IO[bytes] | int, *, shared: bool = False) -> None:
    """Wait for the lock on an open file, and take it; one that is held already changes between shared and not.

    Without ``fcntl`` there are no shared locks: they keep nobody out.
    """
    if fcntl is not None:
        fcntl.flock(file, fcntl.LOCK_SH if shared else fcntl.LOCK_EX)
    elif msvcrt is not None and not isinstance(file, int):
        _lock_byte(file, msvcrt.LK_UNLCK if shared else msvcrt.LK_LOCK)


def try_lock(file: IO[bytes] | int) -> bool:
    """Take the lock on an open file unless someone has it, and return whether it was taken."""
    try:
        if fcntl is not None:
            fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
        elif msvcrt is not None and not isinstance(file, int):
            _lock_byte(file, msvcrt.LK_NBLCK)
    except OSError:
        return False
    return True


def _lock_byte(file: IO[bytes], how: int) -> None:
    file.seek(0)
    with contextlib.suppress(OSError) if how == msvcrt.LK_UNLCK else contextlib.nullcontext():
        msvcrt.locking(file.fileno(), how, 1)


@contextlib.contextmanager
def opened_folder(folder: Path) -> Iterator[int]:
    """Yield a descriptor of a folder for locks on it, which keep nobody out where folders cannot be opened."""
    if fcntl is None:
        yield -1
        return
    descriptor = os.open(folder, os.O_RDONLY)
    try:
        yield descriptor
    finally:
        os.close(descriptor)


def open_lock_file(path: Path) -> int:
    """Open a lock file of this user in a folder where others may write, and return its descriptor.

    Raises
    ------
    MachineError
        It belongs to another user, or a link lies in its place.
    """
    try:
        descriptor = os.open(path, os.O_RDWR | os.O_CREAT | getattr(os, "O_NOFOLLOW", 0), 0o600)
    except OSError as error:
        raise _not_ours(path, error.strerror or "") from error
    if os.fstat(descriptor).st_uid != user_id():
        os.close(descriptor)
        raise _not_ours(path, "it belongs to another user")
    return descriptor


# Folders that no other user may change.


def make_private(folder: Path) -> Path:
    """Make a folder that only this user may enter, unless it is there, and return it.

    Raises
    ------
    OSError
        It cannot be made.
    MachineError
        It, or the link in its place, belongs to another user, who may put anything there.
    """
    if not folder.is_dir():
        folder.parent.mkdir(parents=True, exist_ok=True)
        with contextlib.suppress(FileExistsError):
            folder.mkdir(mode=0o700)
    for status in (folder.lstat(), folder.stat()):
        if status.st_uid != user_id():
            raise _not_ours(folder, "it belongs to another user")
    if not stat.S_ISDIR(folder.stat().st_mode):
        raise NotADirectoryError(0, "it is no folder", str(folder))
    return folder


def user_id() -> int:
    """Return the number of the user for whom this process acts; 0 where users have none, as all files then say."""
    return os.geteuid() if hasattr(os, "geteuid") else 0


def _not_ours(path: Path, reason: str) -> MachineError:
    return MachineError(
        f"{path} cannot be trusted ({reason}); choose another folder for the cache, or remove it",
        remedy=("cache folder",),
    )


# Processes.


def machine_name() -> str:
    """Return a name for one boot of this machine and one namespace of process numbers."""
    host = socket.gethostname()
    try:
        boot = (_PROC / "sys/kernel/random/boot_id").read_text(encoding="ascii").strip()
        return f"{host} {boot} {os.readlink(_PROC / 'self/ns/pid')}"
    except OSError:
        return f"{host} {uuid.getnode():x}"


def process_start(pid: int) -> int | None:
    """Return when a living process started, in ticks that no change of the clock moves; 0 where this cannot be seen.

    ``None`` says that no such process lives.
    """
    try:
        status = (_PROC / str(pid) / "stat").read_text(encoding="utf-8", errors="replace")
    except (FileNotFoundError, ProcessLookupError):
        return _start_elsewhere(pid)
    except PermissionError:
        return 0
    # proc(5): the name in brackets may itself hold brackets and spaces, so the fields count from the last bracket.
    fields = status.rpartition(")")[2].split()
    return None if fields[_STATE_FIELD] in _DEAD_STATES else int(fields[_START_FIELD])


def _start_elsewhere(pid: int) -> int | None:
    """Return what `process_start` does where ``/proc`` is missing, or hides the processes of others (``hidepid=2``)."""
    if (_PROC / "self").exists():
        try:
            os.kill(pid, 0)
        except PermissionError:
            return 0
        except (OSError, OverflowError):
            return None
        return None  # ended between the two looks
    try:
        process = psutil.Process(pid)
        return None if process.status() == psutil.STATUS_ZOMBIE else int(process.create_time() * 100)
    except psutil.NoSuchProcess:
        return None
    except psutil.Error:
        return 0


@contextlib.contextmanager
def interrupts_withheld() -> Iterator[None]:
    """Let processes and threads that start in this context not hear Ctrl-C, where signals can be withheld.

    A process inherits the signal mask of the thread that starts it. Without this, Ctrl-C at a terminal reaches it while
    it imports what it takes to ignore it. Other threads of this process still hear Ctrl-C, and so does this one
    afterwards.
    """
    if not hasattr(signal, "pthread_sigmask"):
        yield
        return
    # Starting the tracker, which the first process of all does, unblocks SIGINT in Python 3.11.
    resource_tracker.ensure_running()
    before = signal.pthread_sigmask(signal.SIG_BLOCK, [])
    try:
        signal.pthread_sigmask(signal.SIG_BLOCK, [signal.SIGINT])
        yield
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, before)


def ignore_interrupts() -> None:
    """Let this process not hear Ctrl-C, which its parent hears too."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    if hasattr(signal, "pthread_sigmask"):
        signal.pthread_sigmask(signal.SIG_UNBLOCK, [signal.SIGINT])  # see `interrupts_withheld`


def end_group() -> None:
    """End this process and, where there are groups of processes, all others of its group."""
    if hasattr(os, "killpg"):
        os.killpg(0, SIGKILL)
    os._exit(1)


# Memory.


@contextlib.contextmanager
def memory_limited(limit_bytes: int) -> Iterator[None]:
    """Let the process, and each program that it starts, take no more than ``limit_bytes`` of new memory (Linux).

    RLIMIT_DATA counts private writable memory, which is what a run uses; RLIMIT_AS would also count the gigabytes of
    address space that thread stacks and libraries merely reserve.
    """
    taken_bytes = _status_bytes("VmData")
    if resource is None or not taken_bytes:
        yield
        return
    soft, hard = resource.getrlimit(resource.RLIMIT_DATA)
    wanted = taken_bytes + limit_bytes
    if hard != resource.RLIM_INFINITY:
        wanted = min(wanted, hard)
    resource.setrlimit(resource.RLIMIT_DATA, (wanted, hard))
    try:
        yield
    finally:
        resource.setrlimit(resource.RLIMIT_DATA, (soft, hard))


def memory_limit_bytes() -> int | None:
    """Return the limit that `memory_limited` has set, or ``None``."""
    soft = resource.getrlimit(resource.RLIMIT_DATA)[0] if resource is not None else -1
    return None if resource is None or soft == resource.RLIM_INFINITY else int(soft)


def reset_peak_memory() -> None:
    """Start a new measurement of `peak_memory_bytes` (Linux; elsewhere the peak is that of the process's life)."""
    with contextlib.suppress(OSError):
        (_PROC / "self/clear_refs").write_text("5", encoding="ascii")


def peak_memory_bytes() -> int:
    """Return the largest resident set since the last reset, or that of the largest program started since."""
    if resource is None:
        info = psutil.Process().memory_info()
        return int(getattr(info, "peak_wset", info.rss))
    unit = 1 if sys.platform == "darwin" else _KIB
    own = _status_bytes("VmHWM") or resource.getrusage(resource.RUSAGE_SELF).ru_maxrss * unit
    return int(max(own, resource.getrusage(resource.RUSAGE_CHILDREN).ru_maxrss * unit))


def _status_bytes(field: str) -> int:
    try:
        lines = (_PROC / "self/status").read_text(encoding="ascii").splitlines()
    except OSError:
        return 0
    return next((int(line.split()[1]) * _KIB for line in lines if line.startswith(f"{field}:")), 0)


def available_memory_bytes() -> int:
    """Return the memory that may still be taken here: by the machine, its control groups and a SLURM job's share."""
    return max(0, min([int(psutil.virtual_memory().available), *_left_in_groups(), *_slurm_bytes()]))


def _left_in_groups(root: Path = Path("/sys/fs/cgroup")) -> Iterator[int]:
    """Yield what is left to this process's control groups, of version 1 and 2, and to the groups around them."""
    for name, limit, usage in (
        ("", "memory.max", "memory.current"),
        ("memory", "memory.limit_in_bytes", "memory.usage_in_bytes"),
    ):
        top = root / name
        group = top / _own_group(name)
        for folder in [group, *group.parents]:
            if not folder.is_relative_to(top):
                break
            with contextlib.suppress(OSError, ValueError):  # the root has no limit, and "max" is none
                most, taken = (int((folder / file).read_text(encoding="ascii")) for file in (limit, usage))
                yield most - taken + _reclaimable_bytes(folder)


def _own_group(controller: str) -> str:
    """Return this process's path among the groups of a controller of version 1, empty for version 2."""
    with contextlib.suppress(OSError):
        for line in (_PROC / "self/cgroup").read_text(encoding="utf-8").splitlines():
            _, names, path = line.split(":", 2)
            if controller in names.split(","):
                return path.lstrip("/")
    return ""


def _reclaimable_bytes(folder: Path) -> int:
    """Return what a group holds of files, and gives back where programs want memory."""
    lines = (folder / "memory.stat").read_text(encoding="ascii").splitlines()
    found = dict(line.split() for line in lines)
    return int(found.get("total_inactive_file", found.get("inactive_file", 0)))


def _slurm_bytes() -> Iterator[int]:
    """Yield the memory that SLURM gives to the job on this node; 0 stands for all of it."""
    with contextlib.suppress(KeyError, ValueError):
        yield int(os.environ["SLURM_MEM_PER_NODE"]) * _MIB or sys.maxsize
    with contextlib.suppress(KeyError, ValueError):
        yield int(os.environ["SLURM_MEM_PER_CPU"]) * int(os.environ["SLURM_CPUS_ON_NODE"]) * _MIB or sys.maxsize
