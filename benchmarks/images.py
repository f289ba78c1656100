"""Give benchmarks the images that they reconstruct: fountain-P11 where it is at hand, else a rendered room."""

import os
from pathlib import Path

from gtf_tune.sequence import Sequence, load_sequence
from gtf_tune.sequence.render.room import RoomSpec, render_room

DATA_VARIABLE = "GTF_TUNE_DATA"
FIXED_OPTIONS = {
    "mapper.bundle_adjustment.refine_focal_length": False,
    "mapper.bundle_adjustment.refine_extra_params": False,
}


def fountain() -> Sequence | None:
    """Return fountain-P11 from the folder that GTF_TUNE_DATA names, or ``None`` where it is not there."""
    folder = Path(os.environ.get(DATA_VARIABLE, "")) / "fountain-P11"
    return load_sequence(folder, "fountain-P11") if os.environ.get(DATA_VARIABLE) and folder.is_dir() else None


def room(folder: Path) -> Sequence:
    """Return a small rendered room below a folder, drawing it the first time."""
    if not (folder / "room").exists():
        render_room(folder / "room", RoomSpec(num_frames=12, width=320, height=240))
    return load_sequence(folder / "room", "rendered room")


def in_words(sequence: Sequence) -> str:
    return f"{sequence.name}, {len(sequence)} images of {sequence.width}x{sequence.height}"
