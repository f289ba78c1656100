"""Load a sequence from a folder in any known layout."""

from os import PathLike
from pathlib import Path

import numpy as np

from gtf_tune.errors import SequenceError
from gtf_tune.sequence.camera import Camera
from gtf_tune.sequence.images import image_size
from gtf_tune.sequence.layouts.base import Layout, Recording
from gtf_tune.sequence.layouts.registry import AUTO, find_layout
from gtf_tune.sequence.selection import Selection
from gtf_tune.sequence.value import Frame, Sequence
from gtf_tune.trajectory import Trajectory
from gtf_tune.trajectory.alignment import MIN_MATCHED

FEWEST_FRAMES = MIN_MATCHED
"""Frames that a sequence must have to be worked on: with fewer, no two trajectories can be compared."""

_ALL = Selection()


def load_sequence(
    path: str | PathLike[str],
    name: str | None = None,
    layout: str = AUTO,
    selection: Selection = _ALL,
    camera: Camera | None = None,
    fewest: int = 1,
) -> Sequence:
    """Return the sequence found at a path.

    Reads the header of every chosen image, so it is quick; pixels are decoded when they are first needed.

    Parameters
    ----------
    path
        A folder, or the file that a layout starts from.
    name
        What to call the sequence; the folder's name if not given.
    layout
        A name from `layout_names`, or "auto" to look at the folder.
    selection
        Which frames are used, and at what size.
    camera
        Intrinsics to use instead of the data set's, for the stored images or any uniform resizing of them.
    fewest
        Frames that must be left after the selection; `FEWEST_FRAMES` for work on the sequence.

    Raises
    ------
    SequenceError
        The layout is unknown, too little is left after the selection, or an image is missing, unreadable or of another
        size than the others; the message names the file.
    """
    root = Path(path).expanduser().absolute()
    if not root.exists():
        raise SequenceError(f"{root}: there is no such file or folder; check the path")
    found = find_layout(root, layout)
    recording = _read(found, root)
    frames = _select(recording, selection, root)
    _require(fewest, frames, recording, root)
    stored = _common_size(frames)
    width, height = selection.image_size(*stored)
    known = camera or recording.camera
    return Sequence(
        name=name or root.name,
        root=root,
        layout=found.name,
        frames=frames,
        width=width,
        height=height,
        camera=known.fitted(*stored).scaled(width, height) if known else None,
        ground_truth=_restricted(recording.ground_truth, frames),
        stored_size=stored,
        has_timestamps=recording.has_timestamps,
        notes=recording.notes,
    )


def _read(layout: Layout, root: Path) -> Recording:
    try:
        return layout.read(root)
    except OSError as error:
        reason = f"{error.filename or root}: cannot be read as layout '{layout.name}' ({error.strerror})"
        raise SequenceError(f"{reason}; check the path and its permissions") from error


def _select(recording: Recording, selection: Selection, root: Path) -> tuple[Frame, ...]:
    if selection.rate_hz and not recording.has_timestamps:
        raise SequenceError(f"{root}: rate_hz needs timestamps, which this data set does not have; use stride")
    positions = selection.positions([frame.timestamp for frame in recording.frames])
    if not positions:
        raise SequenceError(
            f"{root}: the selection leaves none of the {len(recording.frames)} images; start must be smaller than that"
        )
    return tuple(recording.frames[position] for position in positions)


def _require(fewest: int, frames: tuple[Frame, ...], recording: Recording, root: Path) -> None:
    if len(frames) >= fewest:
        return
    if len(frames) == len(recording.frames):
        raise SequenceError(f"{root}: expected at least {fewest} frames, not {len(frames)}; add more images")
    raise SequenceError(
        f"{root}: the selection leaves {len(frames)} of the {len(recording.frames)} frames, at least {fewest} are "
        "needed; change start, stop, stride, rate_hz or max_frames"
    )


def _common_size(frames: tuple[Frame, ...]) -> tuple[int, int]:
    """Return the (width, height) that all images share."""
    first = image_size(frames[0].path)
    for frame in frames[1:]:
        size = image_size(frame.path)
        if size != first:
            raise SequenceError(
                f"{frame.path}: expected {first[0]}x{first[1]} pixels like {frames[0].path.name}, not "
                f"{size[0]}x{size[1]}; a sequence comes from one camera: resize or remove the image"
            )
    return first


def _restricted(ground_truth: Trajectory | None, frames: tuple[Frame, ...]) -> Trajectory | None:
    """Return the poses of the chosen frames, or ``None`` if none of them has one."""
    if ground_truth is None:
        return None
    chosen = ground_truth.select(np.isin(ground_truth.frame_ids, [frame.frame_id for frame in frames]))
    return chosen if len(chosen) else None
