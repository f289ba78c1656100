"""Start a program so that nothing of it outlives the run, and report how it ended."""

import errno
import json
import os
import signal
import subprocess
import sys
import time
from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

from gtf_tune.errors import MachineError, RunError
from gtf_tune.operating_system import SIGKILL, memory_limit_bytes

LOG_LIMIT_BYTES = 5 * 10**6
"""What one program may add to the log of a run; the middle of more than that is left out."""

_SUPERVISOR = Path(__file__).with_name("supervisor.py")
_OWN_VARIABLES = "GTF_TUNE_"
_NEAR_LIMIT = 0.8
_GB = 10**9


@dataclass(frozen=True)
class ProgramExit:
    """How a program ended: a negative ``exit_code`` is the signal that killed it."""

    exit_code: int
    last_line: str
    peak_memory_bytes: int
    wall_s: float


def run_program(
    arguments: Sequence[str],
    folder: Path,
    environment: Mapping[str, str],
    report: Path,
    held_files: Collection[int] = (),
) -> ProgramExit:
    """Run a program in a working folder to its end, with its output on this process's standard output.

    If this process ends first, in whatever way, the program and all that it started are killed. ``environment`` is
    added to that of this process, from which gtf-tune's own variables are withheld: they may hold a password.
    ``held_files`` are descriptors of lock files that stay open until the last process of the program is gone.

    Raises
    ------
    MachineError
        The program cannot be started, or there is no such folder.
    RunError
        The program cannot be given such arguments, or its supervisor was killed.
    """
    if not hasattr(os, "setsid"):
        raise MachineError(
            f"cannot start {arguments[0]}: programs run in sessions of their own here, which Windows lacks; use Linux, "
            "macOS or the Windows Subsystem for Linux"
        )
    if not (folder.is_dir() and os.access(folder, os.X_OK)):
        raise MachineError(
            f"cannot start {arguments[0]}: there is no folder {folder} to start it in; see 'working_folder'"
        )
    started = time.perf_counter()
    inherited = {name: value for name, value in os.environ.items() if not name.startswith(_OWN_VARIABLES)}
    sys.stdout.flush()
    lifeline, held_end = os.pipe()
    try:
        ended = subprocess.run(
            [sys.executable, "-I", "-S", str(_SUPERVISOR), str(report.absolute()), str(LOG_LIMIT_BYTES), *arguments],
            stdin=lifeline,
            stdout=1,
            stderr=2,
            cwd=folder,
            env={**inherited, **environment},
            start_new_session=True,
            pass_fds=tuple(held_files),
            check=False,
        )
    finally:
        os.close(lifeline)
        os.close(held_end)
    return _read_report(report, arguments[0], ended.returncode, time.perf_counter() - started)


def check_exit(name: str, ended: ProgramExit, accepted: Collection[int] = (0,)) -> None:
    """Raise `RunError` with the reason if a program did not end as it should."""
    if ended.exit_code in accepted:
        return
    words = f"; its last words: {ended.last_line}" if ended.last_line else ""
    raise RunError(f"{name} {_how(ended)}{_memory(ended)}{words}", died_of=max(0, -ended.exit_code))


def _how(ended: ProgramExit) -> str:
    if ended.exit_code >= 0:
        return f"ended with exit code {ended.exit_code}"
    known = -ended.exit_code in set(signal.Signals)
    return f"was ended by {signal.Signals(-ended.exit_code).name if known else f'signal {-ended.exit_code}'}"


def _memory(ended: ProgramExit) -> str:
    limit = memory_limit_bytes()
    if limit is not None and ended.peak_memory_bytes > _NEAR_LIMIT * limit:
        return (
            f" after taking {ended.peak_memory_bytes / _GB:.1f} GB of the {limit / _GB:.1f} GB that a run may have "
            "(limits.run_memory_gb)"
        )
    return ", most likely for want of memory" if ended.exit_code == -SIGKILL else ""


def _read_report(report: Path, program: str, supervisor_code: int, wall_s: float) -> ProgramExit:
    try:
        content = json.loads(report.read_text(encoding="utf-8"))
    except (OSError, ValueError) as error:
        killed = f"the supervisor of {program} was killed (exit code {supervisor_code})"
        raise RunError(killed, died_of=SIGKILL) from error
    if "cannot_start" in content:
        # Only arguments that are too long or hold a null character can be the configuration's fault.
        fault = RunError if content["errno"] in (0, errno.E2BIG) else MachineError
        raise fault(f"cannot start {program}: {content['cannot_start']}")
    return ProgramExit(wall_s=wall_s, **content)
