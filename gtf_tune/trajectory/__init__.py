"""Hold, read, write and match camera trajectories."""

from gtf_tune.trajectory.files import TrajectoryFormat, read_trajectory, write_kitti, write_tum
from gtf_tune.trajectory.matching import (
    associate_by_frame_id,
    associate_by_name,
    associate_by_timestamp,
    check_frame_ids,
    matched,
)
from gtf_tune.trajectory.serialization import from_bytes, to_bytes
from gtf_tune.trajectory.value import BoolArray, FloatArray, IntArray, Trajectory

__all__ = [
    "BoolArray",
    "FloatArray",
    "IntArray",
    "Trajectory",
    "TrajectoryFormat",
    "associate_by_frame_id",
    "associate_by_name",
    "associate_by_timestamp",
    "check_frame_ids",
    "from_bytes",
    "matched",
    "read_trajectory",
    "to_bytes",
    "write_kitti",
    "write_tum",
]
