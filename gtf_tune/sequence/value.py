"""Sequence as a value: ordered frames, the cameras that took them and what is known of them."""

import hashlib
import struct
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray

from gtf_tune.errors import SequenceError
from gtf_tune.sequence.camera import Camera
from gtf_tune.sequence.cameras import SequenceCamera, cameras_key, check_numbers, commonest
from gtf_tune.sequence.image_noise import ColourImage, GreyImage
from gtf_tune.sequence.images import read_colour, read_grey
from gtf_tune.trajectory import Trajectory

_FINGERPRINT_THREADS = 2
_STAMPS = "stamps of files"


@dataclass(frozen=True)
class Frame:
    """One image of a sequence.

    ``frame_id`` is its position in the whole recording, ``timestamp`` in seconds, ``camera`` the position of its camera
    among those of the sequence.
    """

    frame_id: int
    path: Path
    timestamp: float
    camera: int = 0


@dataclass(frozen=True, eq=False)
class Sequence:
    """Ordered images of one or more cameras.

    ``ground_truth`` has the frame ids of the frames that have a pose. ``has_timestamps`` is false where the data set
    only orders its images; timestamps then count frames. ``notes`` say what the loader found odd.

    Raises
    ------
    SequenceError
        An image is by a camera that is not among ``cameras``.
    """

    name: str
    root: Path
    layout: str
    frames: tuple[Frame, ...]
    cameras: tuple[SequenceCamera, ...]
    ground_truth: Trajectory | None
    has_timestamps: bool = True
    notes: tuple[str, ...] = ()

    def __post_init__(self) -> None:
        check_numbers(self.cameras, self.taken_by)

    def __len__(self) -> int:
        return len(self.frames)

    @property
    def taken_by(self) -> tuple[int, ...]:
        """Return the position of each frame's camera among ``cameras``."""
        return tuple(frame.camera for frame in self.frames)

    @property
    def main_camera(self) -> SequenceCamera:
        """Return the camera that took the most images."""
        return self.cameras[commonest(self.taken_by)] if self.frames else self.cameras[0]

    @property
    def width(self) -> int:
        """Return the width in pixels of the images of the main camera, as the pipeline sees them."""
        return self.main_camera.width

    @property
    def height(self) -> int:
        """Return the height in pixels of the images of the main camera, as the pipeline sees them."""
        return self.main_camera.height

    @property
    def stored_size(self) -> tuple[int, int]:
        """Return (width, height) in pixels of the files of the main camera."""
        return self.main_camera.stored_size

    @property
    def longest_side(self) -> int:
        """Return the longest side in pixels of any image, as the pipeline sees them."""
        return max(max(camera.size) for camera in self.cameras)

    @property
    def camera(self) -> Camera | None:
        """Return the intrinsics of the only camera; ``None`` where they are unknown or there are several cameras."""
        return self.cameras[0].intrinsics if len(self.cameras) == 1 else None

    @property
    def focal_prior(self) -> float | None:
        """Return the focal length in pixels that the only camera has as a prior."""
        return self.cameras[0].focal_prior if len(self.cameras) == 1 else None

    @property
    def cameras_key(self) -> str:
        """Return the key of the cameras and of who took what; of one camera that of its intrinsics or "unknown"."""
        return cameras_key(self.cameras, self.taken_by)

    def camera_of(self, frame: Frame) -> SequenceCamera:
        """Return the camera that took a frame."""
        return self.cameras[frame.camera]

    def with_camera(self, intrinsics: Camera | None) -> "Sequence":
        """Return a sequence of one camera with these intrinsics for the images as the pipeline sees them."""
        return replace(self, cameras=(replace(self.cameras[0], intrinsics=intrinsics),))

    def with_prior(self, focal_prior: float | None) -> "Sequence":
        """Return a sequence of one camera with this focal length in pixels to start from."""
        return replace(self, cameras=(replace(self.cameras[0], focal_prior=focal_prior),))

    def of_camera(self, number: int) -> "Sequence":
        """Return the part of the sequence that one camera took, as a sequence of one camera."""
        frames = tuple(replace(frame, camera=0) for frame in self.frames if frame.camera == number)
        return replace(self, frames=frames, cameras=(self.cameras[number],))

    def read_grey(self, frame: Frame) -> GreyImage:
        """Return the 8-bit grey pixels of a frame, of shape (height, width), as the pipeline sees them.

        Raises
        ------
        SequenceError
            The file is missing, damaged or has changed its size since the sequence was loaded.
        """
        return self._sized(frame, read_grey(frame.path))

    def read_colour(self, frame: Frame) -> ColourImage:
        """Return the 8-bit pixels of a frame, of shape (height, width, 3), blue first, as the pipeline sees them.

        Images that are stored grey have three equal channels. Raises as `read_grey` does.
        """
        return self._sized(frame, read_colour(frame.path))

    def _sized(self, frame: Frame, pixels: NDArray[np.uint8]) -> NDArray[np.uint8]:
        camera = self.camera_of(frame)
        size = pixels.shape[1], pixels.shape[0]
        if size != camera.stored_size:
            raise SequenceError(
                f"{frame.path}: expected {camera.stored_size[0]}x{camera.stored_size[1]} pixels like the other images, "
                f"not {size[0]}x{size[1]}; resize or remove it"
            )
        if size != camera.size:
            pixels = np.asarray(cv2.resize(pixels, camera.size, interpolation=cv2.INTER_AREA), dtype=np.uint8)
        return pixels

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
                total.update(struct.pack("<qqq", frame.frame_id, *self.camera_of(frame).size) + pixels)
        self.__dict__[_STAMPS] = stamps
        return total.hexdigest()

    @cached_property
    def colour_fingerprint(self) -> str:
        """Return the hex SHA-256 of the fingerprint and of all pixels in colour: grey ones do not say the colour."""
        total = hashlib.sha256(self.fingerprint.encode())
        with ThreadPoolExecutor(_FINGERPRINT_THREADS) as pool:
            for pixels in pool.map(self._colour_digest, self.frames):
                total.update(pixels)
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
        copy = replace(self)  # without fingerprints yet
        in_colour = "colour_fingerprint" in self.__dict__
        if copy.fingerprint != self.fingerprint or (in_colour and copy.colour_fingerprint != self.colour_fingerprint):
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

    def _colour_digest(self, frame: Frame) -> bytes:
        return hashlib.sha256(self.read_colour(frame).tobytes()).digest()


def _stamp(path: Path) -> tuple[int, int, int]:
    try:
        status = path.stat()
    except OSError:
        return 0, 0, 0
    return status.st_size, status.st_mtime_ns, status.st_ino
