"""Cameras of a sequence as a study stores them, and what its files say otherwise later."""

from collections.abc import Mapping
from dataclasses import replace
from typing import Any

from gtf_tune.sequence import Camera, Sequence, SequenceCamera
from gtf_tune.store.studies import StudySequence

_UNKNOWN = "unknown"
_CAMERAS, _TAKEN_BY = "cameras", "taken_by"


def camera_columns(sequence: Sequence) -> tuple[str, dict[str, Any]]:
    """Return what is stored of the cameras of a sequence: the text of the column, and entries of ``info``.

    The text is a model with its parameters, or "unknown"; that of several cameras only says how many there are, and
    ``info`` has them.
    """
    if len(sequence.cameras) > 1:
        cameras = [_stored(camera) for camera in sequence.cameras]
        return f"{len(cameras)} cameras", {_CAMERAS: cameras, _TAKEN_BY: list(sequence.taken_by)}
    [camera] = sequence.cameras
    return camera_text(camera.intrinsics), {} if camera.focal_prior is None else {"focal_prior": camera.focal_prior}


def with_stored_cameras(sequence: Sequence, stored: StudySequence) -> Sequence:
    """Return a sequence with the cameras that its study began with."""
    several = stored.info.get(_CAMERAS)
    if several:
        taken_by = [int(number) for number in stored.info[_TAKEN_BY]]
        cameras = tuple(_restored(camera) for camera in several)
    else:
        taken_by, prior = [0] * len(sequence), stored.info.get("focal_prior")
        intrinsics = _camera(stored.camera, stored.width, stored.height)
        size = sequence.main_camera.stored_size
        prior = None if prior is None else float(prior)
        cameras = (SequenceCamera(stored.width, stored.height, size, intrinsics, prior),)
    if len(taken_by) != len(sequence):  # other images than when the study began, as their pixels will show
        return sequence
    frames = zip(sequence.frames, taken_by, strict=True)
    return replace(sequence, frames=tuple(replace(frame, camera=number) for frame, number in frames), cameras=cameras)


def camera_change(sequence: Sequence, found: Sequence, fault: str) -> str:
    """Return a sentence on what the files of a sequence now say otherwise than when its study began, or "".

    ``found`` is the sequence as its files describe it now; ``fault`` says why they cannot be used any more.
    """
    if not fault and _who_took_what(found) == _who_took_what(sequence):
        return ""
    says = f"its files cannot be used any more ({fault})" if fault else f"its files now say {_words(found)}"
    return (
        f"sequence '{sequence.name}' keeps the intrinsics that the study began with, {_words(sequence)}, although "
        f"{says}"
    )


def camera_text(camera: Camera | None) -> str:
    """Return a camera as it is stored: its model and parameters, or "unknown"."""
    return f"{camera.model} {' '.join(repr(value) for value in camera.params)}" if camera else _UNKNOWN


def _who_took_what(sequence: Sequence) -> list[Camera | int | None]:
    """Return the intrinsics of each image's camera, or which of several it is where they are unknown."""
    if len(sequence.cameras) == 1:
        return [sequence.camera] * len(sequence)
    return [sequence.cameras[number].intrinsics or number for number in sequence.taken_by]


def _words(sequence: Sequence) -> str:
    return camera_columns(sequence)[0]


def _stored(camera: SequenceCamera) -> dict[str, Any]:
    return {
        "width": camera.width,
        "height": camera.height,
        "stored_size": list(camera.stored_size),
        "intrinsics": camera_text(camera.intrinsics),
        "focal_prior": camera.focal_prior,
    }


def _restored(stored: Mapping[str, Any]) -> SequenceCamera:
    width, height = int(stored["width"]), int(stored["height"])
    size, prior = stored["stored_size"], stored["focal_prior"]
    return SequenceCamera(
        width,
        height,
        stored_size=(int(size[0]), int(size[1])),
        intrinsics=_camera(str(stored["intrinsics"]), width, height),
        focal_prior=None if prior is None else float(prior),
    )


def _camera(text: str, width: int, height: int) -> Camera | None:
    if text == _UNKNOWN:
        return None
    model, *params = text.split()
    return Camera(model, width, height, tuple(float(value) for value in params))
