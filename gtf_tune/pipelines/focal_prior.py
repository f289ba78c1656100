"""Ask a pipeline for the focal length that it starts from where intrinsics are unknown."""

from dataclasses import replace
from typing import TYPE_CHECKING

from gtf_tune.pipelines.base import Pipeline

if TYPE_CHECKING:  # whoever only reads studies needs no images
    from gtf_tune.sequence import Sequence


def with_focal_prior(sequence: "Sequence", pipeline: Pipeline) -> "Sequence":
    """Return a sequence of unknown intrinsics with the focal length that the pipeline starts from.

    A pipeline that starts from focal lengths has a method ``focal_prior(sequence)``, which returns what it reads in
    image files, in pixels of the images that it will see, or ``None``. What the data set knows comes first. The
    sequence is returned as it is where nothing is found or the intrinsics are known.
    """
    read = getattr(pipeline, "focal_prior", None)
    if sequence.camera is not None:
        return sequence
    if read is None:
        return sequence if sequence.focal_prior is None else replace(sequence, focal_prior=None)
    return replace(sequence, focal_prior=sequence.focal_prior or read(sequence))
