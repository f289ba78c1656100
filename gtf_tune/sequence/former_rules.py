"""Choose the frames of one camera as studies did that began before sequences could have several."""

from collections.abc import Sequence as Items
from dataclasses import dataclass

from gtf_tune.sequence.camera import Camera
from gtf_tune.sequence.layouts.base import Intrinsics
from gtf_tune.sequence.value import Frame
from gtf_tune.trajectory.alignment import MIN_MATCHED

_NAMED = 5


@dataclass(frozen=True)
class SharedCamera:
    """Frames that share one camera, that camera or its focal length where it is known, and notes on other frames."""

    frames: tuple[Frame, ...]
    camera: Camera | None = None
    notes: tuple[str, ...] = ()
    focal_prior: float | None = None


def shared_camera(frames: tuple[Frame, ...], intrinsics: Intrinsics, rules: int) -> SharedCamera:
    """Return the largest group of frames with one camera, as far as the data set says.

    Where hardly two frames share a camera, as in models with intrinsics for each image, all frames are kept and the
    camera counts as unknown; under rules 1 it always did.
    """
    if len(intrinsics.cameras) == 1:
        return SharedCamera(frames, intrinsics.cameras[0], intrinsics.notes, intrinsics.focal_priors[0])
    groups = _groups(intrinsics.cameras)
    camera, positions = max(groups.items(), key=lambda group: (group[0] is not None, len(group[1])))
    if len(groups) == 1:
        return SharedCamera(frames, camera, intrinsics.notes)
    few = len(positions) < MIN_MATCHED or len(groups) * MIN_MATCHED > len(frames)
    if rules == 1 or few:
        note = f"the images have {len(groups)} different intrinsics, so they count as unknown"
        return SharedCamera(frames, None, (*intrinsics.notes, note))
    kept = set(positions)
    others = [frame.path.name for position, frame in enumerate(frames) if position not in kept]
    named = ", ".join(others[:_NAMED]) + (f" and {len(others) - _NAMED} more" if len(others) > _NAMED else "")
    note = (
        f"the images have {len(groups)} different intrinsics; {len(kept)} that share one camera are used, "
        f"{len(others)} are left out: {named}"
    )
    return SharedCamera(tuple(frames[position] for position in positions), camera, (*intrinsics.notes, note))


def _groups(cameras: Items[Camera | None]) -> dict[Camera | None, list[int]]:
    """Return the positions of the frames of each different camera, in order of their first appearance."""
    groups: dict[Camera | None, list[int]] = {}
    for position, camera in enumerate(cameras):
        groups.setdefault(camera, []).append(position)
    return groups
