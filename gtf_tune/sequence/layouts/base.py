"""State what a layout is: how a data set's folder becomes frames, intrinsics and ground truth."""

from collections.abc import Callable
from collections.abc import Sequence as Items
from dataclasses import dataclass
from pathlib import Path

from gtf_tune.errors import SequenceError
from gtf_tune.sequence.camera import Camera
from gtf_tune.sequence.value import Frame
from gtf_tune.trajectory import Trajectory


@dataclass(frozen=True, eq=False)
class Recording:
    """Hold all that a data set's folder says, before frames are chosen and images resized.

    ``camera`` may be for another resolution of the same images. ``ground_truth`` has the frame ids of the frames that
    have a pose. ``has_timestamps`` is false where timestamps only count frames.
    """

    frames: tuple[Frame, ...]
    camera: Camera | None = None
    ground_truth: Trajectory | None = None
    has_timestamps: bool = True
    notes: tuple[str, ...] = ()


@dataclass(frozen=True)
class Layout:
    """Describe one layout.

    ``matches`` tells from names alone whether a folder (or a file, where the layout starts from one) has it. ``read``
    raises `SequenceError` that names the faulty file. ``help`` says what to download and which path to give.
    """

    name: str
    matches: Callable[[Path], bool]
    read: Callable[[Path], Recording]
    help: str


def one_camera(cameras: Items[Camera]) -> tuple[Camera | None, tuple[str, ...]]:
    """Return the camera that all images share, or ``None`` and a note where their intrinsics differ."""
    if len(set(cameras)) == 1:
        return cameras[0], ()
    return None, (f"the images have {len(set(cameras))} different intrinsics, so they count as unknown",)


def check_unique(frames: tuple[Frame, ...], source: Path) -> None:
    """Raise `SequenceError` if a list of images names a file or a time twice, or is not in order of time."""
    seen: dict[Path, int] = {}
    for number, frame in enumerate(frames):
        if frame.path in seen:
            raise SequenceError(f"{source}: lists the image {frame.path.name} twice; remove one of the lines")
        seen[frame.path] = number
        if number and frame.timestamp <= frames[number - 1].timestamp:
            word = "repeats" if frame.timestamp == frames[number - 1].timestamp else "goes back to"
            raise SequenceError(
                f"{source}: image {frame.path.name} {word} the timestamp {frame.timestamp:.6f}; "
                "timestamps must increase from image to image"
            )
