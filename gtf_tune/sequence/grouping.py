"""Decide which camera took each image, as far as the data set, the image files or the user say."""

from collections.abc import Callable, Hashable
from collections.abc import Sequence as Items
from dataclasses import dataclass, replace

from gtf_tune.errors import SequenceError
from gtf_tune.sequence.camera import Camera
from gtf_tune.sequence.exif import lens_of
from gtf_tune.sequence.selection import Grouping
from gtf_tune.sequence.value import Frame

_NAMED = 5


@dataclass(frozen=True)
class ImageFacts:
    """What is known of one image before the cameras are: its stored (width, height), intrinsics or focal length."""

    size: tuple[int, int]
    intrinsics: Camera | None = None
    focal_prior: float | None = None


@dataclass(frozen=True)
class Grouped:
    """Frames with the positions of their cameras, what is known of each camera, and notes."""

    frames: tuple[Frame, ...]
    cameras: tuple[ImageFacts, ...]
    notes: tuple[str, ...] = ()


def group_frames(frames: tuple[Frame, ...], facts: Items[ImageFacts], grouping: Grouping) -> Grouped:
    """Return the frames with their cameras.

    Parameters
    ----------
    frames, facts
        The chosen frames, and what is known of each.
    grouping
        "auto": images share a camera if they have the same size and the same intrinsics; where these are unknown, the
        same make, model and focal length in their EXIF, as COLMAP groups them. "one", "per-folder", "per-image": as in
        COLMAP. "largest": only the images of the camera that took most of them are kept.

    Raises
    ------
    SequenceError
        Images of one camera have different sizes.
    """
    labels = _labels(frames, facts, grouping)
    numbers = {label: number for number, label in enumerate(dict.fromkeys(labels))}
    taken_by = [numbers[label] for label in labels]
    members = [[position for position, one in enumerate(taken_by) if one == number] for number in range(len(numbers))]
    if grouping == "largest" and len(members) > 1:
        return _only_largest(frames, facts, members)
    notes: list[str] = []
    cameras = tuple(_camera(frames, facts, positions, notes) for positions in members)
    numbered = tuple(replace(frame, camera=number) for frame, number in zip(frames, taken_by, strict=True))
    return Grouped(numbered, cameras, tuple(notes))


def _labels(frames: tuple[Frame, ...], facts: Items[ImageFacts], grouping: Grouping) -> list[Hashable]:
    by: dict[Grouping, Callable[[Frame], Hashable]] = {
        "one": lambda _: "one",
        "per-folder": lambda frame: frame.path.parent,
        "per-image": lambda frame: frame.path,
    }
    if grouping in by:
        return [by[grouping](frame) for frame in frames]
    return [
        (fact.size, fact.intrinsics, fact.focal_prior, None if fact.intrinsics else lens_of(frame))
        for frame, fact in zip(frames, facts, strict=True)
    ]


def _camera(frames: tuple[Frame, ...], facts: Items[ImageFacts], positions: list[int], notes: list[str]) -> ImageFacts:
    """Return what is known of the camera of some frames; intrinsics that differ count as unknown."""
    first = facts[positions[0]]
    for position in positions:
        size = facts[position].size
        if size != first.size:
            raise SequenceError(
                f"{frames[position].path}: expected {first.size[0]}x{first.size[1]} pixels like "
                f"{frames[positions[0]].path.name}, not {size[0]}x{size[1]}; images of one camera have one size: "
                "resize the image, leave it out with exclude, or let the images be grouped by camera",
                remedy=("cameras",),
            )
    known = {facts[position].intrinsics for position in positions}
    if len(known) > 1:
        notes.append(
            f"images that are taken for those of one camera have {len(known)} different intrinsics, "
            "so they count as unknown"
        )
    priors = {facts[position].focal_prior for position in positions}
    return ImageFacts(
        first.size,
        first.intrinsics if len(known) == 1 else None,
        first.focal_prior if len(priors) == 1 else None,
    )


def _only_largest(frames: tuple[Frame, ...], facts: Items[ImageFacts], members: list[list[int]]) -> Grouped:
    kept = max(members, key=len)
    others = sorted(set(range(len(frames))) - set(kept))
    named = ", ".join(frames[position].path.name for position in others[:_NAMED])
    more = f" and {len(others) - _NAMED} more" if len(others) > _NAMED else ""
    note = (
        f"the images come from {len(members)} cameras; the {len(kept)} of the largest group are used, "
        f"{len(others)} are left out: {named}{more}"
    )
    return Grouped(tuple(frames[position] for position in kept), (facts[kept[0]],), (note,))
