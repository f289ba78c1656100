"""Sequence as a value: ordered frames of one camera and what is known of them."""

import hashlib
import struct
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path

import cv2

from gtf_tune.errors import SequenceError
from gtf_tune.sequence.camera import Camera
from gtf_tune.sequence.image_noise import GreyImage
from gtf_tune.sequence.images import read_grey
from gtf_tune.trajectory import Trajectory

_FINGERPRINT_THREADS = 2
_STAMPS = "stamps of files"


@dataclass(frozen=True)
class Frame:
    """One image of a sequence: its position in the whole recording, its file, and its time in seconds."""

    frame_id: int
    path: Path
    timestamp: float


@dataclass(frozen=True, eq=False)
class Sequence:
    """Ordered images of one camera.

    ``width`` and ``height`` are what the pipeline sees, in pixels; ``stored_size`` is that of the files. ``camera``
    belongs to the images as the pipeline sees them. ``ground_truth`` has the frame ids of the frames that have a pose.
    ``has_timestamps`` is false where the data set only orders its images; timestamps then count frames. ``notes`` say
    what the loader found odd. ``focal_prior`` is a focal length in pixels, as the pipeline sees the images, to start
    from where the camera is unknown.
    """

    name: str
    root: Path
    layout: str
    frames: tuple[Frame, ...]
    width: int
    height: int
    camera: Camera | None
    ground_truth: Trajectory | None
    stored_size: tuple[int, int]
    has_timestamps: bool = True
    notes: tuple[str, ...] = ()
    focal_prior: float | None = None

    def __len__(self) -> int:
        return len(self.frames)

    def read_grey(self, frame: Frame) -> GreyImage:
        """Return the 8-bit grey pixels of a frame, of shape (height, width), as the pipeline sees them.

        Raises
        ------
        SequenceError
            The file is missing, damaged or has changed its size since the sequence was loaded.
        """
        grey = read_grey(frame.path)
        if grey.shape[::-1] != self.stored_size:
            raise SequenceError(
                f"{frame.path}: expected {self.stored_size[0]}x{self.stored_size[1]} pixels like the other images, "
                f"not {grey.shape[1]}x{grey.shape[0]}; resize or remove it"
            )
        if grey.shape != (self.height, self.width):
            grey = cv2.resize(grey, (self.width, self.height), interpolation=cv2.INTER_AREA)
        return grey

    @cached_property
    def fingerprint(self) -> str:
        """Return the hex SHA-256 of frame ids, sizes and grey pixels; reads every image once, then remembers.

        It is the digest over (frame id, width, height, SHA-256 of the pixels) of each frame, all numbers as
        little-endian 64-bit integers, which lets frames be hashed side by side.
        """
        stamps = self._stamps()  # before the pixels are read, so that no later change is missed
        total = hashlib.sha256()
        with ThreadPoolExecutor(_FINGERPRINT_THREADS) as pool:
            for frame, pixels in zip(self.frames, pool.map(self._pixel_digest, self.frames), strict=True):
                total.update(struct.pack("<qqq", frame.frame_id, self.width, self.height) + pixels)
        self.__dict__[_STAMPS] = stamps
        return total.hexdigest()

    def check_unchanged(self) -> None:
        """Raise `SequenceError` if the images are no longer those of the fingerprint.

        Pixels are compared only where the size, time or inode of a file differs.
        """
        before = self.__dict__.get(_STAMPS)  # absent where nobody has asked for the fingerprint yet
        if before is None:
            return
        now = self._stamps()
        if now == before:
            return
        if replace(self).fingerprint != self.fingerprint:  # a copy has no fingerprint yet
            raise SequenceError(
                f"the images of sequence '{self.name}' in {self.root} were changed while they were worked on; restore "
                "them, or create a new study"
            )
        self.__dict__[_STAMPS] = now

    def _stamps(self) -> tuple[tuple[int, int, int], ...]:
        """Return size, time and inode of each file; zeros where there is none, which reading it reports."""
        return tuple(_stamp(frame.path) for frame in self.frames)

    def _pixel_digest(self, frame: Frame) -> bytes:
        return hashlib.sha256(self.read_grey(frame).data).digest()


def _stamp(path: Path) -> tuple[int, int, int]:
    try:
        status = path.stat()
    except OSError:
        return 0, 0, 0
    return status.st_size, status.st_mtime_ns, status.st_ino
