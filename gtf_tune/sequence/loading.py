"""Load a sequence from a data set of any known layout, and note what was not read."""

import os
import re
from collections.abc import Collection, Iterator
from dataclasses import replace
from os import PathLike
from pathlib import Path
from typing import Literal

import numpy as np

from gtf_tune.errors import SequenceError
from gtf_tune.sequence.camera import Camera, Lens
from gtf_tune.sequence.cameras import SequenceCamera
from gtf_tune.sequence.former_rules import shared_camera
from gtf_tune.sequence.grouping import ImageFacts, group_frames
from gtf_tune.sequence.image_formats import CLASSIC_SUFFIXES, IMAGE_SUFFIXES
from gtf_tune.sequence.images import image_size
from gtf_tune.sequence.layouts.base import (
    GIVE_THE_CAMERA,
    UNKNOWN,
    Intrinsics,
    Layout,
    Notes,
    Reading,
    Recording,
    naming,
)
from gtf_tune.sequence.layouts.cameras.kalibr import chain_intrinsics, find_chain
from gtf_tune.sequence.layouts.folder import FOLDER, maps_among
from gtf_tune.sequence.layouts.registry import AUTO, find_layout, layout_above
from gtf_tune.sequence.selection import LOADING_RULES, Selection
from gtf_tune.sequence.value import Frame, Sequence
from gtf_tune.trajectory import Trajectory
from gtf_tune.trajectory.alignment import MIN_MATCHED

FEWEST_FRAMES = MIN_MATCHED
"""Frames that a sequence must have to be worked on: with fewer, no two trajectories can be compared."""

CameraChoice = Camera | Lens | Literal["auto", "unknown"]

_ALL = Selection()
_BY_FILES: Literal["auto"] = "auto"


def load_sequence(
    path: str | PathLike[str],
    name: str | None = None,
    layout: str = AUTO,
    selection: Selection = _ALL,
    camera: CameraChoice = _BY_FILES,
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
        "auto" for the data set's intrinsics, "unknown" for none, or those to use instead: a `Camera` for the stored
        images or any uniform resizing of them, a `Lens` for images of one size, which are taken for those of one
        camera. Unless it is "auto", a calibration that cannot be read does not matter.
    fewest
        Frames that must be left after the selection; `FEWEST_FRAMES` for work on the sequence.

    Raises
    ------
    SequenceError
        The layout is unknown, too little is left after the selection, or an image is missing, unreadable or of another
        size than the others of its camera; the message names the file.
    """
    root = Path(path).expanduser().absolute()
    if not root.exists():
        raise SequenceError(f"{root}: there is no such file or folder; check the path")
    found = find_layout(root, layout, recursive=selection.recursive)
    recording = _read(found, root, selection)
    intrinsics, chain = _intrinsics(recording, root) if camera == "auto" else (UNKNOWN, ())
    grouping = selection.cameras
    if isinstance(camera, Lens) and grouping == "auto":
        grouping = "one"
    if selection.rules < LOADING_RULES:
        recording, intrinsics = _of_one_camera(recording, intrinsics, selection.rules)
        grouping = "one"
    frames = _select(recording, recording.frames, selection, root)
    with naming(root):
        facts = _facts(frames, recording, Intrinsics((camera,)) if isinstance(camera, Camera) else intrinsics)
        if isinstance(camera, Lens):
            facts = [replace(fact, intrinsics=camera.camera(*fact.size)) for fact in facts]
        if camera == "auto":
            _refuse_those_of_others(facts)
        grouped = group_frames(frames, facts, grouping)
    frames = grouped.frames
    _require(fewest, frames, recording, root)
    read = (*recording.files, *chain)
    return Sequence(
        name=name or root.name,
        root=root,
        layout=found.name,
        frames=frames,
        cameras=tuple(_resized(known, selection) for known in grouped.cameras),
        ground_truth=_restricted(recording.ground_truth, frames),
        has_timestamps=recording.has_timestamps,
        notes=(
            *recording.notes,
            *intrinsics.notes,
            *grouped.notes,
            *_resizing_notes((camera,) if isinstance(camera, Camera) else intrinsics.cameras, facts),
            *_of_folder(found, root, frames),
            *unread_files(root, read),
        ),
    )


def _of_one_camera(recording: Recording, intrinsics: Intrinsics, rules: int) -> tuple[Recording, Intrinsics]:
    """Return the frames and intrinsics of one camera, for a study that began before sequences could have several."""
    shared = shared_camera(recording.frames, intrinsics, rules)
    return replace(recording, frames=shared.frames), Intrinsics((shared.camera,), shared.notes, (shared.focal_prior,))


def _facts(frames: tuple[Frame, ...], recording: Recording, intrinsics: Intrinsics) -> list[ImageFacts]:
    """Return size, intrinsics and focal length of the chosen frames; reads the header of each."""
    positions = {frame.frame_id: position for position, frame in enumerate(recording.frames)}
    facts = []
    for frame in frames:
        at, size = positions[frame.frame_id], image_size(frame.path)
        camera = intrinsics.cameras[at if len(intrinsics.cameras) > 1 else 0]
        prior = intrinsics.focal_priors[at if len(intrinsics.focal_priors) > 1 else 0]
        facts.append(ImageFacts(size, camera.fitted(*size) if camera else None, prior))
    return facts


def _resized(known: ImageFacts, selection: Selection) -> SequenceCamera:
    """Return the camera of images that are resized as the selection says."""
    width, height = selection.image_size(*known.size)
    return SequenceCamera(
        width,
        height,
        stored_size=known.size,
        intrinsics=known.intrinsics.scaled(width, height) if known.intrinsics else None,
        focal_prior=known.focal_prior * width / known.size[0] if known.focal_prior else None,
    )


def _read(layout: Layout, root: Path, selection: Selection) -> Recording:
    reading = Reading(selection.recursive, CLASSIC_SUFFIXES if selection.rules == 1 else IMAGE_SUFFIXES)
    try:
        return layout.read(root, reading)
    except OSError as error:
        reason = f"{error.filename or root}: cannot be read as layout '{layout.name}' ({error.strerror})"
        raise SequenceError(f"{reason}; check the path and its permissions") from error


def _intrinsics(recording: Recording, root: Path) -> tuple[Intrinsics, tuple[Path, ...]]:
    """Return what the layout's files say about the camera, else what a calibration of Kalibr does, and its file."""
    own = recording.read_intrinsics()
    chain = find_chain(root) if own is UNKNOWN else None
    return (chain_intrinsics(chain, root.name), (chain,)) if chain else (own, ())


def _refuse_those_of_others(facts: list[ImageFacts]) -> None:
    """Raise `SequenceError` for intrinsics that cannot be those of the images; files may not say whose they are."""
    for camera in {fact.intrinsics for fact in facts if fact.intrinsics}:
        values = dict(zip(camera.param_names, camera.params, strict=True))
        centre = values.get("cx", 0.0), values.get("cy", 0.0)
        if not (0 <= centre[0] <= camera.width and 0 <= centre[1] <= camera.height):
            raise SequenceError(
                f"the principal point {centre[0]:.0f}, {centre[1]:.0f} lies outside of the images of "
                f"{camera.width}x{camera.height} pixels, so the intrinsics are those of others; {GIVE_THE_CAMERA}"
            )


def _of_folder(layout: Layout, root: Path, frames: tuple[Frame, ...]) -> Notes:
    """Return notes on a plain folder that is part of a data set, or holds more than photographs."""
    if layout.name != FOLDER.name:
        return ()
    above = layout_above(root)
    if above is None:
        return maps_among(frames)
    name, folder = above
    return (f"{folder} looks like layout '{name}': give that folder to use its camera and poses", *maps_among(frames))


def _resizing_notes(cameras: tuple[Camera | None, ...], facts: list[ImageFacts]) -> Iterator[str]:
    """Yield a note for each pair of sizes between which intrinsics were scaled."""
    described = {camera.size for camera in cameras if camera}
    if not described:
        return
    stored = dict.fromkeys(fact.size for fact in facts if fact.intrinsics)
    for size in stored:
        if size not in described:
            before = " or ".join(f"{width}x{height}" for width, height in sorted(described))
            yield f"the intrinsics are for {before} images and were scaled to those of {size[0]}x{size[1]}"


def _select(recording: Recording, frames: tuple[Frame, ...], selection: Selection, root: Path) -> tuple[Frame, ...]:
    if selection.rate_hz and not recording.has_timestamps:
        raise SequenceError(f"{root}: rate_hz needs timestamps, which this data set does not have; use stride")
    kept = selection.without_excluded(frames, root)
    positions = selection.positions([frame.timestamp for frame in kept])
    if not positions:
        raise SequenceError(
            f"{root}: the selection leaves none of the {len(kept)} images; start must be smaller than that"
        )
    return tuple(kept[position] for position in positions)


def _require(fewest: int, frames: tuple[Frame, ...], recording: Recording, root: Path) -> None:
    if len(frames) >= fewest:
        return
    if len(frames) == len(recording.frames):
        raise SequenceError(f"{root}: expected at least {fewest} frames, not {len(frames)}; add more images")
    raise SequenceError(
        f"{root}: the selection leaves {len(frames)} of the {len(recording.frames)} frames, at least {fewest} are "
        "needed; change start, stop, stride, rate_hz, max_frames or exclude"
    )


def _restricted(ground_truth: Trajectory | None, frames: tuple[Frame, ...]) -> Trajectory | None:
    """Return the poses of the chosen frames, or ``None`` if none of them has one."""
    if ground_truth is None:
        return None
    chosen = ground_truth.select(np.isin(ground_truth.frame_ids, [frame.frame_id for frame in frames]))
    return chosen if len(chosen) else None


_SUFFIXES = frozenset(
    [
        ".txt",
        ".csv",
        ".tsv",
        ".dat",
        ".yaml",
        ".yml",
        ".json",
        ".xml",
        ".toml",
        ".ini",
        ".cfg",
        ".conf",
        ".npy",
        ".npz",
        ".mat",
        ".camera",
        ".cam",
        ".calib",
        ".db",
        ".bin",
        ".pkl",
        ".freiburg",
        ".log",
        ".tum",
        ".kitti",
        ".bag",
        ".db3",
        ".mcap",
        ".nvm",
        ".out",
        ".sfm",
        ".g2o",
    ]
)
_BEARING = re.compile(
    r"calib|camera|(^|[_.-])cams?([_.0-9-]|$)|intrin|extrin|distort|fisheye|sensor|pose|traj|odom|ground.?truth|"
    r"(^|[_.-])gt([_.-]|$)|mocap|vicon|leica|transform|camchain|(^|[_.-])rigs?[_.-]|times?(tamps?)?([_.-]|$)|"
    r"colmap|sfm|bundle|reconstruction|_par\.txt$|krt|^ost\.|settings|tum[0-9x]|kitti|euroc|\.nvm$|\.g2o$|^k\.txt$|^database\.db$|^images\.(txt|bin)$",
    re.IGNORECASE,
)
# Known parts of data sets that say nothing of a single camera's images.
_HARMLESS = re.compile(
    r"depth|imu|(^|[_.-])right|[_.-]right|readme|requirements|license|accelero|gyro|(^|[_.-])cam[1-9]", re.IGNORECASE
)
_NAMED = 6
_DEPTH = 2
_MOST_FOLDERS = 50


def unread_files(root: Path, read: Collection[Path]) -> Notes:
    """Return a note on files below ``root`` that may describe camera or poses and are not among those read.

    Names decide: nothing is opened, and folders below the second level are not looked into.
    """
    known = {path.absolute() for path in read}
    found = [path for path in _files(root) if path.absolute() not in known and _bears(path)]
    if not found:
        return ()
    names = [str(path.relative_to(root)) for path in sorted(found)]
    more = f" and {len(names) - _NAMED} more" if len(names) > _NAMED else ""
    return (f"files that may describe camera or poses and are not read: {', '.join(names[:_NAMED])}{more}",)


def _bears(path: Path) -> bool:
    # The folder says what data.csv and sensor.yaml of EuRoC are.
    name = f"{path.parent.name}_{path.name}" if path.stem in ("data", "sensor") else path.name
    return path.suffix.lower() in _SUFFIXES and bool(_BEARING.search(name)) and not _HARMLESS.search(name)


def _files(root: Path) -> Iterator[Path]:
    folder = root if root.is_dir() else root.parent
    for number, (name, folders, files) in enumerate(os.walk(folder)):
        depth = len(Path(name).relative_to(folder).parts)
        folders[:] = sorted(inner for inner in folders if not inner.startswith(".")) if depth < _DEPTH else []
        if number >= _MOST_FOLDERS:
            return
        yield from (Path(name, file) for file in files if not file.startswith("."))
