"""Choose which frames of a sequence are used, and at what size."""

import fnmatch
import math
from collections.abc import Sequence as Items
from dataclasses import dataclass
from pathlib import Path
from typing import Literal

from gtf_tune.errors import SequenceError
from gtf_tune.sequence.value import Frame

# A frame that is early by less than this share of the period counts as on time: timestamps are rounded.
_EARLY = 1e-3


LOADING_RULES = 3
"""Rules by which folders are read now.

Rules 1 read fewer formats and took all images for those of one camera; rules 2 kept the images of one camera only.
"""

Grouping = Literal["auto", "one", "per-folder", "per-image", "largest"]
"""Which images share a camera; see `gtf_tune.sequence.grouping.group_frames`."""


@dataclass(frozen=True)
class Selection:
    """Which frames of a sequence are used, and at what size; the default uses all of them as they are.

    The steps apply in this order:

    1. ``start``, ``stop``, ``stride`` act on positions like a Python slice (``stop = 0`` means: to the end; no negative
       numbers).
    2. ``rate_hz`` thins by timestamps: the first frame that is not earlier than each multiple of ``1 / rate_hz`` after
       the first frame (0 keeps all). Frames inside a gap of the recording are not made up.
    3. ``max_frames`` keeps the first so many (0 keeps all).

    So the paper's "50 of 2000 images, 3.06 Hz" is ``Selection(rate_hz=3.0, max_frames=50)``: every tenth of 30 Hz.
    The 50 frames span 49 x 10 / 30 = 16.33 s, and 50 / 16.33 is 3.06. 50 frames spread evenly over 2000 are
    ``Selection(stride=40)``.

    ``exclude`` leaves images out before all that, by glob patterns of their names or of their paths below the folder;
    frames keep their numbers. ``recursive`` takes the images of subfolders too where the data set is a plain folder.

    ``cameras`` says which images share a camera: "auto" asks the data set and the image files; "one", "per-folder" and
    "per-image" are COLMAP's; "largest" keeps only the images of the camera that took most of them.

    ``rules`` are `LOADING_RULES`, or those that a stored study began with, so that it keeps its frames.

    ``max_image_size`` shrinks images so that the longer side has at most that many pixels (0 leaves them); intrinsics
    follow.

    Raises
    ------
    SequenceError
        A number is outside its range.
    """

    start: int = 0
    stop: int = 0
    stride: int = 1
    rate_hz: float = 0.0
    max_frames: int = 0
    max_image_size: int = 0
    exclude: tuple[str, ...] = ()
    recursive: bool = False
    cameras: Grouping = "auto"
    rules: int = LOADING_RULES

    def __post_init__(self) -> None:
        lowest = {"start": 0, "stop": 0, "stride": 1, "rate_hz": 0, "max_frames": 0, "max_image_size": 0}
        for name, low in lowest.items():
            value = getattr(self, name)
            if not math.isfinite(value) or value < low or (name != "rate_hz" and value != int(value)):
                kind = "finite" if name == "rate_hz" else "whole"
                raise SequenceError(f"{name} must be a {kind} number of at least {low}, not {value:g}")
        if self.stop and self.stop <= self.start:
            raise SequenceError(f"stop must be larger than start ({self.start}), not {self.stop}; 0 means to the end")

    def without_excluded(self, frames: tuple[Frame, ...], root: Path) -> tuple[Frame, ...]:
        """Return the frames whose images no pattern excludes, or raise `SequenceError` for a pattern that fits none."""
        folder = root if root.is_dir() else root.parent
        for pattern in self.exclude:
            kept = tuple(frame for frame in frames if not _fits(frame.path, folder, pattern))
            if len(kept) == len(frames):
                raise SequenceError(
                    f"exclude '{pattern}' fits none of the {len(frames)} images, such as {frames[0].path.name}; check "
                    "the pattern"
                )
            if not kept:
                raise SequenceError(f"exclude '{pattern}' leaves no image; give a pattern that fits fewer")
            frames = kept
        return frames

    def positions(self, timestamps: Items[float]) -> list[int]:
        """Return the positions of the chosen frames among frames with these timestamps in seconds."""
        chosen = list(range(len(timestamps)))[self.start : self.stop or None : self.stride]
        if self.rate_hz > 0:
            chosen = _thinned(chosen, timestamps, self.rate_hz)
        return chosen[: self.max_frames or None]

    def image_size(self, width: int, height: int) -> tuple[int, int]:
        """Return (width, height) after shrinking; no side falls below one pixel."""
        longest = max(width, height)
        if not self.max_image_size or longest <= self.max_image_size:
            return width, height
        factor = self.max_image_size / longest
        return max(1, round(width * factor)), max(1, round(height * factor))


def _fits(path: Path, folder: Path, pattern: str) -> bool:
    names = [path.name, *([path.relative_to(folder).as_posix()] if path.is_relative_to(folder) else [])]
    return any(fnmatch.fnmatchcase(name, pattern) for name in names)


def _thinned(positions: list[int], timestamps: Items[float], rate_hz: float) -> list[int]:
    kept: list[int] = []
    due = 0
    for position in positions:
        elapsed = (timestamps[position] - timestamps[positions[0]]) * rate_hz
        if elapsed >= due - _EARLY:
            kept.append(position)
            due = math.floor(elapsed + _EARLY) + 1
    return kept
