"""Say what a sequence holds, and warn of what will hurt a reconstruction."""

import math
from collections.abc import Callable, Iterable
from collections.abc import Sequence as Items
from dataclasses import dataclass

import numpy as np

from gtf_tune.sequence.camera import Camera
from gtf_tune.sequence.cameras import SequenceCamera
from gtf_tune.sequence.content import FrameContent, PairContent, frame_content, pair_content
from gtf_tune.sequence.exif import exif_notes
from gtf_tune.sequence.loading import FEWEST_FRAMES
from gtf_tune.sequence.turning import turning_pairs
from gtf_tune.sequence.value import Sequence

_CHECKED_FRAMES = 60
_NAMED_FRAMES = 5
_NAMED_CAMERAS = 6

_FEWEST_CORNERS = 150
_FEWEST_MATCHES = 40
_BLUR_SHARE = 0.3
_DARK, _BRIGHT = 25.0, 230.0
_STILL_PX = 0.5
_GAP_FACTOR = 3.0
_LINE_TOLERANCE = 1e-3
_FOV_DEG = (20.0, 120.0)
_OFF_CENTRE = 0.15


@dataclass(frozen=True)
class Gap:
    """Break in the recording: the frames before and after it, and the seconds between them."""

    before: int
    after: int
    seconds: float


@dataclass(frozen=True)
class CameraReport:
    """One camera of a sequence: sizes in pixels, what is known of it, and the names of its images in order."""

    width: int
    height: int
    stored_width: int
    stored_height: int
    intrinsics: Camera | None
    field_of_view_deg: float
    focal_prior: float | None
    images: tuple[str, ...]


@dataclass(frozen=True)
class SequenceReport:
    """What `inspect_sequence` found.

    Sizes, ``camera``, ``field_of_view_deg`` and ``focal_prior`` are those of the only camera; of several, sizes are
    those of the one that took the most images, and ``cameras`` has all. ``rate_hz`` and ``duration_s`` are 0 where
    there are no timestamps. ``field_of_view_deg`` is horizontal, 0 where intrinsics are unknown; ``focal_prior`` is a
    rough focal length in pixels then. ``ground_truth_extent`` is the RMS distance of the true positions from their
    mean, in the data set's unit. ``checked_frames`` images were looked at, evenly spread; ``warnings`` are full
    sentences.
    """

    name: str
    root: str
    layout: str
    frames: int
    width: int
    height: int
    stored_width: int
    stored_height: int
    rate_hz: float
    duration_s: float
    gaps: tuple[Gap, ...]
    camera: Camera | None
    field_of_view_deg: float
    ground_truth_frames: int
    ground_truth_extent: float
    checked_frames: int
    median_corners: float
    median_shift_px: float
    notes: tuple[str, ...]
    warnings: tuple[str, ...]
    focal_prior: float | None = None
    cameras: tuple[CameraReport, ...] = ()


def inspect_sequence(sequence: Sequence) -> SequenceReport:
    """Return a report on a sequence; decodes up to 60 images and their successors.

    Raises
    ------
    SequenceError
        An image cannot be read.
    """
    frames, pairs = _look(sequence)
    rate, gaps = _timing(sequence)
    stamps = [frame.timestamp for frame in sequence.frames]
    shifts = [pair.shift_px for pair in pairs if math.isfinite(pair.shift_px)]
    truth = sequence.ground_truth
    return SequenceReport(
        name=sequence.name,
        root=str(sequence.root),
        layout=sequence.layout,
        frames=len(sequence),
        width=sequence.width,
        height=sequence.height,
        stored_width=sequence.stored_size[0],
        stored_height=sequence.stored_size[1],
        rate_hz=rate,
        duration_s=stamps[-1] - stamps[0] if sequence.has_timestamps else 0.0,
        gaps=gaps,
        camera=sequence.camera,
        field_of_view_deg=_field_of_view_deg(sequence.camera),
        ground_truth_frames=len(truth) if truth else 0,
        ground_truth_extent=float(np.sqrt(truth.positions.var(axis=0).sum())) if truth else 0.0,
        checked_frames=len(frames),
        median_corners=float(np.median([frame.corners for frame in frames])),
        median_shift_px=float(np.median(shifts)) if shifts else 0.0,
        notes=sequence_notes(sequence),
        warnings=(*_warn_of_frames(frames), *_warn_of_pairs(pairs, sequence), *_warn_of_facts(sequence, gaps)),
        focal_prior=sequence.focal_prior,
        cameras=_cameras(sequence),
    )


def _cameras(sequence: Sequence) -> tuple[CameraReport, ...]:
    return tuple(
        CameraReport(
            *camera.size,
            *camera.stored_size,
            camera.intrinsics,
            _field_of_view_deg(camera.intrinsics),
            camera.prior,
            tuple(frame.path.name for frame in sequence.frames if frame.camera == number),
        )
        for number, camera in enumerate(sequence.cameras)
    )


def sequence_notes(sequence: Sequence) -> tuple[str, ...]:
    """Return what the loader found odd, and what EXIF says against it; reads the header of every image."""
    return (*sequence.notes, *exif_notes(sequence))


def say_notes(sequence: Sequence, say: Callable[[str], None], *, named: bool = False) -> None:
    """Print a line for each irregularity of a sequence, and one for each camera whose intrinsics are unknown.

    ``named`` says of which sequence it is.
    """
    notes = list(sequence_notes(sequence))
    if len(sequence.cameras) > 1:
        notes.append(_said_of_cameras(sequence))
    elif sequence.camera is None:
        prior = sequence.focal_prior
        start = f"starts from a focal length of {prior:.4g} pixels" if prior else "estimates them"
        notes.append(f"intrinsics are unknown; the pipeline {start}")
    else:
        notes += _warn_of_camera(sequence.cameras[0])
    of = f"sequence '{sequence.name}': " if named else ""
    for note in notes:
        say(f"note: {of}{note}")


def _said_of_cameras(sequence: Sequence) -> str:
    """Return a sentence on several cameras: how many images of what size, and what is known of each."""
    found = []
    for number, camera in enumerate(sequence.cameras[:_NAMED_CAMERAS]):
        known = "known" if camera.intrinsics else "unknown"
        if camera.prior:
            known = f"unknown but for a focal length of {camera.prior:.4g} pixels"
        count = sequence.taken_by.count(number)
        found.append(f"{count} of {camera.width}x{camera.height} pixels (intrinsics {known})")
    more = f" and {len(sequence.cameras) - len(found)} more cameras" if len(sequence.cameras) > len(found) else ""
    return f"the images come from {len(sequence.cameras)} cameras: {', '.join(found)}{more}"


def _look(sequence: Sequence) -> tuple[list[FrameContent], list[PairContent]]:
    """Measure images evenly spread over the sequence, and each with its successor."""
    count = min(len(sequence), _CHECKED_FRAMES)
    chosen = np.unique(np.linspace(0, len(sequence) - 1, count).astype(int))
    frames, pairs = [], []
    for position in chosen:
        frame = sequence.frames[position]
        grey = sequence.read_grey(frame)
        frames.append(frame_content(frame.frame_id, grey))
        if position + 1 < len(sequence):
            after = sequence.frames[position + 1]
            ids = (frame.frame_id, after.frame_id)
            pairs.append(pair_content(ids, grey, sequence.read_grey(after)))
    return frames, pairs


def _timing(sequence: Sequence) -> tuple[float, tuple[Gap, ...]]:
    """Return the median rate in Hz, and the breaks of more than three median periods."""
    if not sequence.has_timestamps or len(sequence) < 2:
        return 0.0, ()
    steps = np.diff([frame.timestamp for frame in sequence.frames])
    period = float(np.median(steps))
    late = np.flatnonzero(steps > _GAP_FACTOR * period)
    ids = [frame.frame_id for frame in sequence.frames]
    return 1 / period, tuple(Gap(ids[index], ids[index + 1], float(steps[index])) for index in late)


def _field_of_view_deg(camera: Camera | None) -> float:
    """Return the horizontal field of view without distortion, 0 where there is no focal length."""
    values = dict(zip(camera.param_names, camera.params, strict=True)) if camera else {}
    focal = values.get("fx", values.get("f", 0.0))
    return math.degrees(2 * math.atan(camera.width / (2 * focal))) if camera and focal else 0.0


def _warn_of_frames(frames: Items[FrameContent]) -> Iterable[str]:
    typical = float(np.median([frame.sharpness for frame in frames]))
    checks: tuple[tuple[str, Callable[[FrameContent], bool]], ...] = (
        (
            "much less sharp than the others: blurred images lose features and shift those that remain",
            lambda frame: frame.sharpness < _BLUR_SHARE * typical,
        ),
        (
            f"poor in texture, with fewer than {_FEWEST_CORNERS} corners: they may stay unregistered",
            lambda frame: frame.corners < _FEWEST_CORNERS,
        ),
        (
            "very dark: noise will hide their texture (16-bit images with 12-bit values look so)",
            lambda frame: frame.mean_grey < _DARK,
        ),
        ("very bright: overexposed parts hold no features", lambda frame: frame.mean_grey > _BRIGHT),
    )
    for words, hurts in checks:
        yield from _sentence([frame.frame_id for frame in frames if hurts(frame)], len(frames), f"images are {words}")


def _warn_of_pairs(pairs: Items[PairContent], sequence: Sequence) -> Iterable[str]:
    turned = _turned(pairs, sequence)
    checks: tuple[tuple[str, Callable[[PairContent], bool]], ...] = (
        ("images equal the next one exactly: duplicates add time but no information", lambda pair: pair.identical),
        (
            f"images share fewer than {_FEWEST_MATCHES} features with the next one: the reconstruction may break there",
            lambda pair: not pair.identical and pair.matches < _FEWEST_MATCHES,
        ),
        (
            "images hardly differ from the next one: the camera stood still, thin them out by stride or rate_hz",
            lambda pair: not pair.identical and pair.shift_px < _STILL_PX,
        ),
        (
            "images differ from the next one by a turn of the camera only: positions are weakly determined there",
            lambda pair: pair.first in turned and pair.shift_px >= _STILL_PX,
        ),
    )
    for words, hurts in checks:
        yield from _sentence([pair.first for pair in pairs if hurts(pair)], len(pairs), words)


def _turned(pairs: Items[PairContent], sequence: Sequence) -> set[int]:
    """Return the first frame of each pair of one camera's images between which that camera only turned."""
    taken_by = {frame.frame_id: frame.camera for frame in sequence.frames}
    turned: set[int] = set()
    for number, camera in enumerate(sequence.cameras):
        of_camera = [
            pair.homography if taken_by[pair.first] == taken_by[pair.second] == number else None for pair in pairs
        ]
        turning = turning_pairs(of_camera, camera.size, camera.intrinsics)
        turned |= {pair.first for pair, turns in zip(pairs, turning, strict=True) if turns}
    return turned


def _sentence(frame_ids: list[int], checked: int, words: str) -> Iterable[str]:
    if frame_ids:
        named = ", ".join(str(frame_id) for frame_id in frame_ids[:_NAMED_FRAMES])
        more = ", ..." if len(frame_ids) > _NAMED_FRAMES else ""
        yield f"{len(frame_ids)} of {checked} checked {words} (frames {named}{more})"


def _warn_of_facts(sequence: Sequence, gaps: tuple[Gap, ...]) -> Iterable[str]:
    if len(sequence) < FEWEST_FRAMES:
        few = "1 image is" if len(sequence) == 1 else f"{len(sequence)} images are"
        yield f"{few} too few for a study: trajectories are compared over at least {FEWEST_FRAMES}"
    if gaps:
        counted = "1 gap" if len(gaps) == 1 else f"{len(gaps)} gaps"
        yield f"the recording has {counted}; sequential matching may not bridge them"
    yield from _warn_of_cameras(sequence)
    yield from _warn_of_ground_truth(sequence)


def _warn_of_cameras(sequence: Sequence) -> Iterable[str]:
    """Yield what is odd about each camera, without its number where that is so of all."""
    found = [tuple(_warn_of_camera(camera)) for camera in sequence.cameras]
    if len(set(found)) == 1:
        yield from found[0]
        return
    for number, warnings in enumerate(found, 1):
        yield from (f"camera {number}: {warning}" for warning in warnings)


def _warn_of_camera(described: SequenceCamera) -> Iterable[str]:
    camera = described.intrinsics
    if camera is None and described.focal_prior is not None:
        yield "of the intrinsics only a rough focal length is known: refining it costs precision"
        return
    if camera is None:
        yield "intrinsics are unknown: the pipeline has to find them, which costs precision"
        return
    angle = _field_of_view_deg(camera)
    if angle and "FISHEYE" not in camera.model and not _FOV_DEG[0] <= angle <= _FOV_DEG[1]:
        yield f"a field of view of {angle:.0f} degrees is unusual: check whether the intrinsics belong to these images"
    values = dict(zip(camera.param_names, camera.params, strict=True))
    sides = {"cx": camera.width, "cy": camera.height}
    if any(abs(values.get(name, side / 2) / side - 0.5) > _OFF_CENTRE for name, side in sides.items()):
        yield "the principal point is far from the centre: check whether the intrinsics belong to these images"


def _warn_of_ground_truth(sequence: Sequence) -> Iterable[str]:
    truth = sequence.ground_truth
    if truth is None:
        return
    if len(truth) < len(sequence):
        yield f"ground truth covers {len(truth)} of {len(sequence)} images"
    spread = np.linalg.svd(truth.positions - truth.positions.mean(axis=0), compute_uv=False)
    if len(truth) < FEWEST_FRAMES or spread[0] == 0 or spread[1] < _LINE_TOLERANCE * spread[0]:
        yield "true positions are too few or lie on a line: trajectories cannot be aligned to them with certainty"
