"""Prepare a sequence for a pipeline: refuse cameras that it cannot take, read focal lengths that it starts from."""

from dataclasses import replace
from typing import TYPE_CHECKING

from gtf_tune.errors import SequenceError
from gtf_tune.pipelines.base import Pipeline

if TYPE_CHECKING:  # whoever only reads studies needs no images
    from gtf_tune.sequence import Sequence


def with_focal_prior(sequence: "Sequence", pipeline: Pipeline) -> "Sequence":
    """Return a sequence whose cameras of unknown intrinsics have the focal lengths that the pipeline starts from.

    A pipeline that starts from focal lengths has a method ``focal_prior(sequence)``, which returns what it reads in
    the image files of one camera, in pixels of the images that it will see, or ``None``. What the data set knows comes
    first. The sequence is returned as it is where nothing is found or all intrinsics are known.

    Raises
    ------
    SequenceError
        The images come from several cameras, and the pipeline takes one.
    """
    _check_cameras(sequence, pipeline)
    read = getattr(pipeline, "focal_prior", None)
    cameras = []
    for number, camera in enumerate(sequence.cameras):
        prior = camera.focal_prior
        if camera.intrinsics is None:
            prior = None if read is None else prior or read(sequence.of_camera(number))
        cameras.append(camera if prior == camera.focal_prior else replace(camera, focal_prior=prior))
    return sequence if tuple(cameras) == sequence.cameras else replace(sequence, cameras=tuple(cameras))


def _check_cameras(sequence: "Sequence", pipeline: Pipeline) -> None:
    count = len(sequence.cameras)
    if count > 1 and not getattr(pipeline, "takes_several_cameras", False):
        largest = max(sequence.taken_by.count(number) for number in range(count))
        raise SequenceError(
            f"pipeline '{pipeline.name}' takes the images of one camera, but those of sequence '{sequence.name}' come "
            f"from {count}; use only the {largest} images of the largest group, or a pipeline of COLMAP",
            remedy=("largest group",),
        )
