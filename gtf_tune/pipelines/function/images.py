"""The images of one run as a Python function is given them."""

from collections.abc import Sequence
from functools import cached_property
from pathlib import Path
from typing import overload

import numpy as np

from gtf_tune.pipelines.base import PipelineJob
from gtf_tune.sequence import Camera, ImageSource
from gtf_tune.sequence.image_noise import GreyImage
from gtf_tune.trajectory import FloatArray, IntArray


class RunImages:
    """Images of one run: 8-bit grey, clean or with noise; only what is asked for is read or written.

    Attributes
    ----------
    names
        n file names in ``folder``, in the order of the sequence.
    frame_ids
        (n,) int64, the position of each image in the full sequence; increasing, with gaps where frames are left out.
    timestamps
        (n,) seconds, increasing; where the sequence has none they count the images.
    camera
        Intrinsics in COLMAP's convention, pixel centres at +0.5, for the images as they are; ``None`` where unknown.
    arrays
        n grey images of shape (height, width), uint8; each is read when it is indexed.
    workspace
        An empty folder of the run's own for whatever the function writes; it is deleted after the run.
    """

    def __init__(self, job: PipelineJob) -> None:
        frames = job.images.sequence.frames
        self._job = job
        self.names: tuple[str, ...] = job.images.names
        self.frame_ids: IntArray = np.array([frame.frame_id for frame in frames], dtype=np.int64)
        self.timestamps: FloatArray = np.array([frame.timestamp for frame in frames], dtype=np.float64)
        self.camera: Camera | None = job.camera
        self.arrays: Sequence[GreyImage] = _Arrays(job.images)
        self.workspace: Path = job.workspace

    def __len__(self) -> int:
        return len(self.names)

    @cached_property
    def folder(self) -> Path:
        """A read-only folder with the images as binary PGM files; written, or taken from the cache, when asked for."""
        return self._job.stages.reach("images", self._job.images.key, self._job.images.write)


class _Arrays(Sequence[GreyImage]):
    def __init__(self, images: ImageSource) -> None:
        self._images = images

    def __len__(self) -> int:
        return len(self._images.sequence.frames)

    @overload
    def __getitem__(self, index: int) -> GreyImage: ...

    @overload
    def __getitem__(self, index: slice) -> list[GreyImage]: ...

    def __getitem__(self, index: int | slice) -> GreyImage | list[GreyImage]:
        frames = self._images.sequence.frames[index]
        return (
            [self._images.read(frame) for frame in frames] if isinstance(frames, tuple) else self._images.read(frames)
        )
