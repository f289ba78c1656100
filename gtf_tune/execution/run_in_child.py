"""Execute one run inside a worker process."""

import contextlib
import errno
import platform
import signal
import time
import traceback
from dataclasses import replace

import numpy as np

from gtf_tune.errors import DefinitionError, OptionError, RunError, SequenceError, StorageError
from gtf_tune.execution.base import RunLimits
from gtf_tune.execution.paths import RunPaths
from gtf_tune.execution.process import memory_limited, output_to, peak_memory_bytes, reset_peak_memory
from gtf_tune.execution.stages import StageStore
from gtf_tune.pipelines.base import PipelineJob, PipelineOutput
from gtf_tune.pipelines.run import RunOutcome, RunRequest
from gtf_tune.sequence import Sequence
from gtf_tune.trajectory import Trajectory
from gtf_tune.version import __version__

_MACHINE_FAULTS = {errno.ENOSPC, errno.EDQUOT, errno.EROFS, errno.EACCES, errno.EPERM, errno.EMFILE, errno.ENFILE}
_GIB = 2**30


def execute(request: RunRequest, limits: RunLimits, paths: RunPaths, store: StageStore) -> RunOutcome:
    """Run the pipeline once and return how it ended.

    Raises
    ------
    StorageError, SequenceError, DefinitionError
        This machine is at fault, not the options: the disk is full, a folder cannot be written, an image cannot be
        read, or the pipeline cannot be imported.
    """
    started_at = time.time()
    clock = time.perf_counter()
    reset_peak_memory()
    output, error = _run_logged(request, limits, paths, store)
    return RunOutcome(
        status="failed" if error else "ok",
        trajectory=output.trajectory,
        error=error,
        diagnostics=dict(output.diagnostics),
        wall_s=time.perf_counter() - clock,
        peak_memory_bytes=peak_memory_bytes(),
        host=platform.node(),
        started_at=started_at,
        versions=versions_of(request),
        log=paths.read_log_tail() if error else "",
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


def _run_logged(
    request: RunRequest, limits: RunLimits, paths: RunPaths, store: StageStore
) -> tuple[PipelineOutput, str]:
    nothing = PipelineOutput(Trajectory.empty())
    with output_to(paths.log), memory_limited(limits.memory_bytes):
        try:
            return _run(request, paths, store), ""
        except RunError as error:
            return nothing, str(error)
        except OptionError as error:
            return nothing, str(error)
        except (SequenceError, DefinitionError):  # what the run needs is not on this machine
            raise
        except MemoryError:
            return nothing, f"the run needed more than its memory limit of {limits.memory_bytes / _GIB:g} GB"
        except OSError as error:
            _log_traceback()
            if error.errno in _MACHINE_FAULTS:
                raise StorageError(
                    f"a run could not write to {error.filename or paths.folder} ({error.strerror}); "
                    "make room or choose another place with --cache-dir, then resume the study"
                ) from error
            return nothing, f"{type(error).__name__}: {error}"
        except Exception as error:  # a run may fail in any way; the reason is kept and the study goes on
            _log_traceback()
            return nothing, f"{type(error).__name__}: {error}"


def _log_traceback() -> None:
    with contextlib.suppress(OSError):  # the log's own disk may be the full one
        traceback.print_exc()


def _run(request: RunRequest, paths: RunPaths, store: StageStore) -> PipelineOutput:
    with store.open(paths.workspace / "stages") as stages:
        workspace = paths.workspace / "pipeline"
        workspace.mkdir()
        job = PipelineJob(
            images=request.images,
            camera=request.sequence.camera,
            options=request.options,
            seed=request.seed,
            threads=request.threads,
            workspace=workspace,
            stages=stages,
            focal_prior=request.focal_prior,
        )
        output = request.pipeline.run(job)
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
