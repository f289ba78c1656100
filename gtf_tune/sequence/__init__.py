"""Load, select and write the images that pipelines are tuned on."""

from gtf_tune.sequence.camera import MODEL_PARAMS, Camera, Lens, pinhole_from_opencv
from gtf_tune.sequence.cameras import SequenceCamera
from gtf_tune.sequence.inspection import Gap, SequenceReport, inspect_sequence, say_notes
from gtf_tune.sequence.layouts.registry import layout_help, layout_names
from gtf_tune.sequence.loading import FEWEST_FRAMES, load_sequence
from gtf_tune.sequence.render.room import RoomSpec, render_room
from gtf_tune.sequence.selection import LOADING_RULES, Selection
from gtf_tune.sequence.source import ImageSource
from gtf_tune.sequence.value import Frame, Sequence
from gtf_tune.sequence.video import Extraction, extract_video

__all__ = [
    "FEWEST_FRAMES",
    "LOADING_RULES",
    "MODEL_PARAMS",
    "Camera",
    "Extraction",
    "Frame",
    "Gap",
    "ImageSource",
    "Lens",
    "RoomSpec",
    "Selection",
    "Sequence",
    "SequenceCamera",
    "SequenceReport",
    "extract_video",
    "inspect_sequence",
    "layout_help",
    "layout_names",
    "load_sequence",
    "pinhole_from_opencv",
    "render_room",
    "say_notes",
]
