"""Ask a pipeline for the focal length that it starts from where intrinsics are unknown."""

from dataclasses import replace
from typing import TYPE_CHECKING

from gtf_tune.pipelines.base import Pipeline

if TYPE_CHECKING:  # whoever only reads studies needs no images
    from gtf_tune.sequence import Sequence


def with_focal_prior(sequence: "Sequence", pipeline: Pipeline) -> "Sequence":
    """Return a sequence of unknown intrinsics with the focal length that the pipeline starts from.

    A pipeline that reads focal lengths from image files has a method ``focal_prior(sequence)``, which returns one in
    pixels of the images that it will see, or ``None``. The sequence is returned as it is where nothing is found or the
    intrinsics are known.
    """
    read = getattr(pipeline, "focal_prior", None)
    if sequence.camera is not None or read is None:
        return sequence
    return replace(sequence, focal_prior=read(sequence))
