"""Write the clean or noisy images that a pipeline reads."""

import hashlib
import math
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from gtf_tune.errors import MachineError, SequenceError
from gtf_tune.sequence.image_noise import NOISE_VERSION, GreyImage, noisy_image
from gtf_tune.sequence.value import Frame, Sequence

_SUFFIX = ".pgm"


@dataclass(frozen=True, eq=False)
class ImageSource:
    """One copy of a sequence for a pipeline: 8-bit images with Gaussian noise of ``sigma`` grey levels.

    ``channels`` is 1 for grey images and 3 for colour, where each channel has noise of its own.

    ``sigma = 0`` is the clean copy; it goes through the same writer, and ``seed`` then means nothing.

    Raises
    ------
    SequenceError
        Sigma or seed is outside its range.
    """

    sequence: Sequence
    sigma: float = 0.0
    seed: int = 0
    channels: Literal[1, 3] = 1

    def __post_init__(self) -> None:
        if not (math.isfinite(self.sigma) and self.sigma >= 0 and self.seed >= 0):
            raise SequenceError(
                f"noise needs a finite sigma and a seed, neither below 0, not {self.sigma!r} and {self.seed!r}"
            )

    @property
    def key(self) -> str:
        """Return the hex SHA-256 of everything that the written images depend on."""
        noise = f"{NOISE_VERSION} {self.sigma!r} {self.seed}" if self.sigma else "clean"
        pixels = self.sequence.fingerprint if self.channels == 1 else f"colour {self.sequence.colour_fingerprint}"
        return hashlib.sha256(f"{pixels} {noise}".encode()).hexdigest()

    @property
    def names(self) -> tuple[str, ...]:
        """Return the file name of each frame, in order."""
        return tuple(_file_name(frame) for frame in self.sequence.frames)

    def frame_id_of(self, name: str) -> int:
        """Return the frame id of a file that `write` wrote; folders before the name do not matter.

        Raises
        ------
        SequenceError
            No frame of the sequence has this name.
        """
        found = self._frame_ids.get(Path(name).name)
        if found is None:
            raise SequenceError(f"'{name}' is not an image of sequence '{self.sequence.name}'")
        return found

    @cached_property
    def _frame_ids(self) -> dict[str, int]:
        return {_file_name(frame): frame.frame_id for frame in self.sequence.frames}

    def read(self, frame: Frame) -> NDArray[np.uint8]:
        """Return the clean or noisy pixels of a frame, of shape (height, width), or (height, width, 3) in colour."""
        read = self.sequence.read_grey if self.channels == 1 else self.sequence.read_colour
        return noisy_image(read(frame), self.sigma, seed=self.seed, frame_id=frame.frame_id)

    def write(self, folder: Path, threads: int = 1) -> None:
        """Write every frame of a grey copy into an existing folder as a binary PGM file named by its frame id.

        PGM has no compression: it is written and read at the speed of a copy (see benchmarks/noise_throughput.py). The
        files are the same whatever ``threads`` is.

        Raises
        ------
        SequenceError
            An image cannot be read, or the copy is in colour.
        MachineError
            The folder cannot be written to.
        """
        if self.channels != 1:
            raise SequenceError("a PGM file has no colour; write the pixels that `read` gives in another format")

        def write_one(frame: Frame) -> None:
            _write_pgm(folder / _file_name(frame), self.read(frame))

        with ThreadPoolExecutor(threads) as pool:
            list(pool.map(write_one, self.sequence.frames))


def _file_name(frame: Frame) -> str:
    return f"{frame.frame_id:06d}{_SUFFIX}"


def _write_pgm(path: Path, grey: GreyImage) -> None:
    height, width = grey.shape
    try:
        with path.open("wb") as file:
            file.write(f"P5\n{width} {height}\n255\n".encode())
            file.write(grey.data)
    except OSError as error:
        raise MachineError(
            f"{path}: cannot write the image ({error.strerror}); make room or choose another folder for the cache"
        ) from error
