"""State what a pipeline is: the contract between gtf-tune and the programs that it tunes."""

import contextlib
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Protocol

from gtf_tune.pipelines.options import OptionTable, OptionValue

if TYPE_CHECKING:  # whoever only reads studies needs neither images nor poses
    from gtf_tune.sequence import Camera, ImageSource
    from gtf_tune.trajectory import Trajectory

DiagnosticValue = bool | int | float | str


class Stages(Protocol):
    """Give pipelines the folders of their stages, from the stage cache where one is in use."""

    def reach(self, stage: str, key: str, build: Callable[[Path], None]) -> Path:
        """Return a folder that holds the files of a stage, after calling ``build(folder)`` if no copy is at hand.

        ``key`` is a hex digest of everything that the files depend on. The folder is read-only to the caller and stays
        until the run ends. An exception of ``build`` passes through and leaves nothing behind.
        """
        ...


@dataclass(frozen=True)
class PipelineJob:
    """What one run of a pipeline works on.

    ``images`` are the clean or noisy grey images, ``options`` the checked values that differ from the pipeline's
    defaults, ``seed`` a non-negative 31-bit number, ``workspace`` an empty folder of the run's own. ``waiting`` opens a
    context for waits that are not the run's own, such as that for a GPU: they do not count towards its time limit.
    """

    images: "ImageSource"
    options: Mapping[str, OptionValue]
    seed: int
    threads: int
    workspace: Path
    stages: Stages
    waiting: Callable[[], contextlib.AbstractContextManager[None]] = contextlib.nullcontext

    @property
    def camera(self) -> "Camera | None":
        """Return the intrinsics in COLMAP's convention, ``None`` where they are unknown or there are several cameras.

        A pipeline that takes several cameras has a true ``takes_several_cameras`` and finds them in
        ``images.sequence.cameras``; no other is given any.
        """
        return self.images.sequence.camera

    @property
    def focal_prior(self) -> float | None:
        """Return the focal length in pixels to start from where the intrinsics of the only camera are unknown."""
        return self.images.sequence.focal_prior


@dataclass(frozen=True)
class PipelineOutput:
    """What one run of a pipeline gives back.

    ``trajectory`` has one pose per registered frame, with the frame ids of the job's images. ``diagnostics`` are short
    scalars such as ``num_points3D``, ``mean_reprojection_error_px`` or ``num_models``; names that end in ``_s`` are
    seconds of a stage.
    """

    trajectory: "Trajectory"
    diagnostics: Mapping[str, DiagnosticValue] = field(default_factory=dict)


class Pipeline(Protocol):
    """Run one program on one set of images with one set of options.

    Implementations are values: cheap to make, picklable, without state between runs. ``name`` is what users type,
    ``version`` changes whenever results may, ``settings`` is everything besides options that results depend on, as
    short scalars (``{"pairing": "exhaustive"}``).
    """

    name: str
    version: str
    settings: Mapping[str, str]

    @property
    def options(self) -> OptionTable:
        """Return the table of all tunable options with their defaults."""
        ...

    def run(self, job: PipelineJob) -> PipelineOutput:
        """Return the trajectory that the program finds for the job.

        Equal jobs with ``threads = 1`` give equal trajectories on one machine wherever the program allows it. Writes
        only below ``job.workspace`` and through ``job.stages``; may print, the caller keeps the output as the run's
        log. May hang, leak or abort: the caller runs it in a child process with a time and a memory limit.

        Raises
        ------
        RunError
            The program ended without a usable trajectory; the message is the reason that users read.
        MachineError
            This machine cannot run the program, whatever the options: it is missing, or its files cannot be written.
        """
        ...
