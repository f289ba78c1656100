"""What a layout is: how a data set's folder becomes frames, intrinsics and ground truth."""

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path

from gtf_tune.errors import SequenceError, TrajectoryError
from gtf_tune.sequence.camera import Camera
from gtf_tune.sequence.image_formats import IMAGE_SUFFIXES
from gtf_tune.sequence.value import Frame
from gtf_tune.trajectory import Trajectory

GIVE_THE_CAMERA = 'give the camera, or set it to "unknown" to let the pipeline estimate it'
"""What to do about a calibration that cannot be used."""


Notes = tuple[str, ...]


@dataclass(frozen=True)
class Intrinsics:
    """What a data set's files say about its cameras.

    ``cameras`` has one for all frames, or one for each frame; ``None`` is a camera that the files do not describe. A
    camera may be for another resolution of the same images. ``notes`` say what was found odd. ``focal_priors`` are
    focal lengths in pixels of the stored images, to start from where the camera is unknown: one for all frames, or one
    for each.
    """

    cameras: tuple[Camera | None, ...] = (None,)
    notes: tuple[str, ...] = ()
    focal_priors: tuple[float | None, ...] = (None,)


UNKNOWN = Intrinsics()
"""What a data set without a calibration says about its camera."""


@dataclass(frozen=True, eq=False)
class Recording:
    """All that a data set's folder says, before frames are chosen and images resized.

    ``read_intrinsics`` is called only where nobody gives the camera, so it alone fails on a calibration that cannot be
    used. ``ground_truth`` has the frame ids of the frames that have a pose. ``has_timestamps`` is false where
    timestamps only count frames. ``files`` are those that were read, besides images.
    """

    frames: tuple[Frame, ...]
    read_intrinsics: Callable[[], Intrinsics] = lambda: UNKNOWN
    ground_truth: Trajectory | None = None
    has_timestamps: bool = True
    notes: tuple[str, ...] = ()
    files: tuple[Path, ...] = ()


@dataclass(frozen=True)
class Reading:
    """How a folder is read: with its subfolders or without, and which endings of names are those of images."""

    recursive: bool = False
    suffixes: frozenset[str] = IMAGE_SUFFIXES


@dataclass(frozen=True)
class Layout:
    """One layout.

    ``matches`` decides from names alone whether a folder (or a file, where the layout starts from one) has it. ``read``
    raises `SequenceError` that names the faulty file. ``help`` says what to download and which path to give.
    """

    name: str
    matches: Callable[[Path], bool]
    read: Callable[[Path, Reading], Recording]
    help: str


def one_camera(camera: Camera | None, *notes: str) -> Intrinsics:
    """Return the intrinsics of images that all come from one camera."""
    return Intrinsics((camera,), notes)


@contextmanager
def naming(path: Path) -> Iterator[None]:
    """Put the file before what is wrong with the values that were read from it."""
    try:
        yield
    except (SequenceError, TrajectoryError) as error:
        if str(path) in str(error):
            raise
        raise SequenceError(f"{path}: {error}") from error


def check_unique(frames: tuple[Frame, ...], source: Path) -> None:
    """Raise `SequenceError` if a list of images names a file or a time twice, or is not in order of time."""
    seen: set[Path] = set()
    for number, frame in enumerate(frames):
        if frame.path in seen:
            raise SequenceError(f"{source}: lists the image {frame.path.name} twice; remove one of the lines")
        seen.add(frame.path)
        if number and frame.timestamp <= frames[number - 1].timestamp:
            word = "repeats" if frame.timestamp == frames[number - 1].timestamp else "goes back to"
            raise SequenceError(
                f"{source}: image {frame.path.name} {word} the timestamp {frame.timestamp:.6f}; "
                "timestamps must increase from image to image"
            )
