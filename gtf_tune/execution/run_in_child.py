"""Execute one run inside a worker process."""

import contextlib
import errno
import platform
import signal
import time
import traceback
from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from gtf_tune.errors import DefinitionError, MachineError, OptionError, RunError, SequenceError
from gtf_tune.execution.base import RunLimits
from gtf_tune.execution.paths import RunPaths
from gtf_tune.execution.process import PhaseNote, cause_of_death, output_to
from gtf_tune.execution.stages import StageStore
from gtf_tune.operating_system import memory_limited, peak_memory_bytes, reset_peak_memory
from gtf_tune.pipelines.base import PipelineJob, PipelineOutput, Stages
from gtf_tune.pipelines.run import FailureCause, RunOutcome, RunRequest
from gtf_tune.sequence import Sequence
from gtf_tune.trajectory import Trajectory
from gtf_tune.version import __version__

_MACHINE_FAULTS = frozenset(
    getattr(errno, name)
    for name in (
        *("ENOSPC", "EDQUOT", "EROFS", "EACCES", "EPERM", "EMFILE", "ENFILE", "EIO", "EAGAIN"),
        *("ENOLCK", "ESTALE", "ENODEV", "ENXIO", "ENOTCONN", "EHOSTDOWN", "EHOSTUNREACH", "ETXTBSY", "EBUSY"),
    )
    if hasattr(errno, name)
)
_GIB = 2**30


@dataclass(frozen=True)
class _Ending:
    """How the pipeline ended: with its output, or with why it failed."""

    output: PipelineOutput
    error: str = ""
    cause: FailureCause = "configuration"


def execute(request: RunRequest, limits: RunLimits, paths: RunPaths, store: StageStore) -> RunOutcome:
    """Run the pipeline once and return how it ended.

    Raises
    ------
    SequenceError, DefinitionError
        An image cannot be read, or the pipeline cannot be imported.
    """
    started_at = time.time()
    clock = time.perf_counter()
    reset_peak_memory()
    try:
        ending = _run_logged(request, limits, paths, store)
    except MachineError as error:
        ending = _failed(str(error), "machine")
    return RunOutcome(
        status="failed" if ending.error else "ok",
        trajectory=ending.output.trajectory,
        error=ending.error,
        diagnostics=dict(ending.output.diagnostics),
        wall_s=time.perf_counter() - clock,
        peak_memory_bytes=peak_memory_bytes(),
        host=platform.node(),
        started_at=started_at,
        versions=versions_of(request),
        log=paths.read_log_tail() if ending.error else "",
        cause=ending.cause,
    )


def execute_in_worker(request: RunRequest, limits: RunLimits, paths: RunPaths, store: StageStore) -> RunOutcome:
    """Run the pipeline once in a process of the executor's own; see `execute`.

    Importing pycolmap, which unpickling the request does, installs a handler that prints a stack trace on SIGTERM, the
    signal by which a worker process is told to end.
    """
    signal.signal(signal.SIGTERM, signal.SIG_DFL)
    return execute(request, limits, paths, store)


def versions_of(request: RunRequest) -> dict[str, str]:
    """Return the versions that a run depends on."""
    return {
        "gtf_tune": __version__,
        request.pipeline.name: request.pipeline.version,
        "python": platform.python_version(),
    }


def _failed(error: str, cause: FailureCause) -> _Ending:
    return _Ending(PipelineOutput(Trajectory.empty()), error, cause)


def _run_logged(request: RunRequest, limits: RunLimits, paths: RunPaths, store: StageStore) -> _Ending:
    with output_to(paths.log), memory_limited(limits.memory_bytes):
        try:
            return _Ending(_run(request, paths, store))
        except RunError as error:
            return _failed(str(error), cause_of_death(error.died_of) if error.died_of else "configuration")
        except OptionError as error:
            return _failed(str(error), "configuration")
        except (SequenceError, DefinitionError, MachineError):  # what the run needs is not on this machine
            raise
        except MemoryError:
            needed = f"the run needed more than its memory limit of {limits.memory_bytes / _GIB:g} GB"
            return _failed(needed, "configuration")
        except OSError as error:
            _log_traceback()
            return _failed(*_from_system(error, paths))
        except Exception as error:  # a run may fail in any way; the reason is kept and the study goes on
            _log_traceback()
            return _failed(f"{type(error).__name__}: {error}", "unknown")


def _from_system(error: OSError, paths: RunPaths) -> tuple[str, FailureCause]:
    if error.errno not in _MACHINE_FAULTS:
        return f"{type(error).__name__}: {error}", "unknown"
    return (
        f"a run could not use {error.filename or paths.folder} ({error.strerror}); make room, check its permissions or "
        "choose another folder for the cache",
        "machine",
    )


def _log_traceback() -> None:
    with contextlib.suppress(OSError):  # the log's own disk may be the full one
        traceback.print_exc()


@dataclass(frozen=True)
class _TimedStages:
    """Stages that note when the run builds one of them, and when it waits for another run that does."""

    stages: Stages
    note: PhaseNote

    def reach(self, stage: str, key: str, build: Callable[[Path], None]) -> Path:
        def build_timed(folder: Path) -> None:
            with self.note.stage(stage):
                build(folder)

        with self.note.waiting():
            return self.stages.reach(stage, key, build_timed)


def _run(request: RunRequest, paths: RunPaths, store: StageStore) -> PipelineOutput:
    note = PhaseNote(paths.phase)
    request.sequence.check_unchanged()
    with store.open(paths.workspace / "stages") as stages:
        workspace = paths.workspace / "pipeline"
        workspace.mkdir()
        job = PipelineJob(
            images=request.images,
            options=request.options,
            seed=request.seed,
            threads=request.threads,
            workspace=workspace,
            stages=_TimedStages(stages, note),
            waiting=note.waiting,
        )
        output = request.pipeline.run(job)
    request.sequence.check_unchanged()
    if len(output.trajectory) == 0:
        raise RunError("the pipeline gave back a trajectory without poses")
    if output.trajectory.ids_are_counted:
        return replace(output, trajectory=_of_frames(output.trajectory, request.sequence))
    return output


def _of_frames(trajectory: Trajectory, sequence: Sequence) -> Trajectory:
    """Return a trajectory as read from a file under the frame ids of its images, where it has a pose of each."""
    if len(trajectory) != len(sequence.frames):
        raise RunError(
            f"the pipeline gave back {len(trajectory)} poses for {len(sequence.frames)} images, numbered by their "
            "order only, so nothing says which images they are of; it has to give each pose the frame id of its image"
        )
    return trajectory.with_frame_ids(np.array([frame.frame_id for frame in sequence.frames], dtype=np.int64))
