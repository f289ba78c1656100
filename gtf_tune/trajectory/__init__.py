"""Hold, read, write and match camera trajectories."""

from gtf_tune.trajectory.association import (
    associate_by_frame_id,
    associate_by_name,
    associate_by_timestamp,
    matched,
)
from gtf_tune.trajectory.serialization import from_bytes, to_bytes
from gtf_tune.trajectory.value import BoolArray, FloatArray, IntArray, Trajectory

__all__ = [
    "BoolArray",
    "FloatArray",
    "IntArray",
    "Trajectory",
    "associate_by_frame_id",
    "associate_by_name",
    "associate_by_timestamp",
    "from_bytes",
    "matched",
    "to_bytes",
]
