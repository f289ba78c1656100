"""Load, select and write the images that pipelines are tuned on."""

from gtf_tune.sequence.camera import MODEL_PARAMS, Camera, pinhole_from_opencv
from gtf_tune.sequence.layouts.registry import layout_help, layout_names
from gtf_tune.sequence.loading import load_sequence
from gtf_tune.sequence.render.room import RoomSpec, render_room
from gtf_tune.sequence.selection import Selection
from gtf_tune.sequence.source import ImageSource
from gtf_tune.sequence.value import Frame, Sequence

__all__ = [
    "MODEL_PARAMS",
    "Camera",
    "Frame",
    "ImageSource",
    "RoomSpec",
    "Selection",
    "Sequence",
    "layout_help",
    "layout_names",
    "load_sequence",
    "pinhole_from_opencv",
    "render_room",
]
