"""Cameras of a sequence: what is known of each of them, and which images they took."""

import hashlib
import json
from collections import Counter
from collections.abc import Sequence as Items
from dataclasses import dataclass

from gtf_tune.errors import SequenceError
from gtf_tune.sequence.camera import Camera

UNKNOWN_KEY = "unknown"


@dataclass(frozen=True)
class SequenceCamera:
    """One camera of a sequence: the size of its images and what is known of it.

    ``width`` and ``height`` are what the pipeline sees, in pixels; ``stored_size`` is that of the files. ``intrinsics``
    belong to the images as the pipeline sees them, ``None`` where unknown. ``focal_prior`` is a focal length in pixels,
    as the pipeline sees the images, to start from where they are.
    """

    width: int
    height: int
    stored_size: tuple[int, int]
    intrinsics: Camera | None = None
    focal_prior: float | None = None

    @property
    def size(self) -> tuple[int, int]:
        """Return (width, height) in pixels, as the pipeline sees the images."""
        return self.width, self.height

    @property
    def prior(self) -> float | None:
        """Return the focal length to start from, only where the intrinsics are unknown."""
        return self.focal_prior if self.intrinsics is None else None

    @property
    def stored_intrinsics(self) -> Camera | None:
        """Return the intrinsics for the images as they are stored."""
        return self.intrinsics.scaled(*self.stored_size) if self.intrinsics else None

    @property
    def key(self) -> str:
        """Return the key of the intrinsics, or "unknown"; it belongs to stored keys."""
        return self.intrinsics.key if self.intrinsics else UNKNOWN_KEY


def cameras_key(cameras: Items[SequenceCamera], taken_by: Items[int]) -> str:
    """Return the key of a sequence's cameras; that of a single one is the key of its intrinsics or "unknown"."""
    if len(cameras) == 1:
        return cameras[0].key
    each = [[camera.key, camera.width, camera.height, repr(camera.prior)] for camera in cameras]
    return hashlib.sha256(json.dumps([each, list(taken_by)]).encode()).hexdigest()


def commonest(taken_by: Items[int]) -> int:
    """Return the number of the camera that took the most images, the first of several."""
    counts = Counter(taken_by)
    return min(counts, key=lambda number: (-counts[number], number))


def check_numbers(cameras: Items[SequenceCamera], taken_by: Items[int]) -> None:
    """Raise `SequenceError` if an image is by a camera that there is not."""
    if not cameras or not all(0 <= number < len(cameras) for number in taken_by):
        raise SequenceError(f"expected images of {len(cameras)} cameras, found other numbers; check the sequence")
