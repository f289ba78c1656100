"""Take frames out of a video."""

import math
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from itertools import groupby, islice
from os import PathLike
from pathlib import Path
from typing import Literal

import cv2
import numpy as np
from numpy.typing import NDArray

from gtf_tune.errors import SequenceError
from gtf_tune.sequence.images import sharpness

FrameChoice = Literal["regular", "sharpest"]

_TimedPicture = tuple[float, NDArray[np.uint8]]

# Timestamps are rounded: a frame that is early by less than this share of a period counts as on time.
_EARLY = 1e-3


@dataclass(frozen=True)
class Extraction:
    """Which frames to take: one per ``1 / rate_hz`` seconds, between ``start_s`` and ``stop_s`` (0: to the end).

    ``choice = "regular"`` takes the first frame of each period, ``"sharpest"`` the one with the largest variance of the
    Laplacian: less blur for slightly irregular times, which the written timestamps have. ``max_frames`` stops after so
    many (0: no limit).

    Raises
    ------
    SequenceError
        A number is outside its range.
    """

    rate_hz: float = 5.0
    choice: FrameChoice = "sharpest"
    start_s: float = 0.0
    stop_s: float = 0.0
    max_frames: int = 0

    def __post_init__(self) -> None:
        if not (math.isfinite(self.rate_hz) and self.rate_hz > 0):
            raise SequenceError(f"rate_hz must be a positive number of frames per second, not {self.rate_hz!r}")
        if self.choice not in ("regular", "sharpest"):
            raise SequenceError(f"choice must be regular or sharpest, not '{self.choice}'")
        for name in ("start_s", "stop_s", "max_frames"):
            if not getattr(self, name) >= 0:
                raise SequenceError(f"{name} must be at least 0, not {getattr(self, name)!r}")
        if self.stop_s and self.stop_s <= self.start_s:
            raise SequenceError(f"stop_s must be larger than start_s ({self.start_s:g}), not {self.stop_s:g}")


_DEFAULT = Extraction()


def extract_video(path: str | PathLike[str], folder: str | PathLike[str], extraction: Extraction = _DEFAULT) -> Path:
    """Write frames of a video as a sequence (rgb/000000.png and so on, rgb.txt with seconds) and return its folder.

    Timestamps are the video's own where it has them. A rotation that phones note in the file is applied by OpenCV, the
    same for all frames.

    Raises
    ------
    SequenceError
        The video cannot be read or holds no frame in the chosen time, the folder already holds a sequence, or it cannot
        be written to.
    """
    video, root = Path(path).expanduser().absolute(), Path(folder).expanduser().absolute()
    if (root / "rgb.txt").exists():
        raise SequenceError(f"{root}: there already is a sequence; give a new folder, or delete this one")
    lines = ["# timestamp filename"]
    try:
        for number, (seconds, picture) in enumerate(_chosen(video, extraction)):
            (root / "rgb").mkdir(parents=True, exist_ok=True)
            name = f"rgb/{number:06d}.png"
            (root / name).write_bytes(cv2.imencode(".png", picture)[1].tobytes())
            lines.append(f"{seconds:.6f} {name}")
        if len(lines) == 1:
            raise SequenceError(f"{video}: found no frames in the chosen time; check start_s and stop_s, or the file")
        (root / "rgb.txt").write_text("\n".join(lines) + "\n")
    except OSError as error:
        raise SequenceError(f"{root}: cannot write the frames ({error.strerror}); check folder and disk") from error
    return root


def _chosen(video: Path, extraction: Extraction) -> Iterator[_TimedPicture]:
    """Return time and picture of the chosen frame of each period."""

    def period(frame: _TimedPicture) -> int:
        return math.floor((frame[0] - extraction.start_s) * extraction.rate_hz + _EARLY)

    pick = _sharpest if extraction.choice == "sharpest" else _first
    periods = groupby(_timed_frames(video, extraction), key=period)
    return islice((pick(frames) for _, frames in periods), extraction.max_frames or None)


def _first(frames: Iterator[_TimedPicture]) -> _TimedPicture:
    return next(frames)


def _sharpest(frames: Iterator[_TimedPicture]) -> _TimedPicture:
    return max(frames, key=lambda frame: sharpness(cv2.cvtColor(frame[1], cv2.COLOR_BGR2GRAY)))


def _timed_frames(video: Path, extraction: Extraction) -> Iterator[_TimedPicture]:
    """Yield the frames of the chosen time with strictly increasing seconds."""
    with _opened(video) as capture:
        period = 1 / (capture.get(cv2.CAP_PROP_FPS) or 1.0)
        last = -period
        while True:
            found, picture = capture.read()
            # Some containers give no times after the first frame: frames are counted there.
            stamp = capture.get(cv2.CAP_PROP_POS_MSEC) / 1000
            last = stamp if stamp > last else last + period
            if not found or (extraction.stop_s and last >= extraction.stop_s):
                return
            if last >= extraction.start_s:
                yield last, picture


@contextmanager
def _opened(video: Path) -> Iterator[cv2.VideoCapture]:
    if not video.is_file():
        raise SequenceError(f"{video}: there is no such video; check the path")
    if not str(video).isprintable():  # OpenCV crashes over names that are no UTF-8
        raise SequenceError(f"{str(video)!r}: the path has letters that cannot be read; rename the file or its folder")
    capture = cv2.VideoCapture(str(video))
    try:
        if not capture.isOpened():
            raise SequenceError(f"{video}: cannot be opened as a video; convert it, for example to MP4 with H.264")
        yield capture
    finally:
        capture.release()
