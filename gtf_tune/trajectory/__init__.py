"""Camera trajectories: read, write, associate and compare them."""

from gtf_tune.trajectory.association import MAX_DIFFERENCE_S, Association, associate, association_of
from gtf_tune.trajectory.files import TrajectoryFormat, read_trajectory, write_kitti, write_tum
from gtf_tune.trajectory.matching import (
    associate_by_frame_id,
    associate_by_name,
    associate_by_timestamp,
    check_frame_ids,
    matched,
)
from gtf_tune.trajectory.value import BoolArray, FloatArray, IntArray, Trajectory, from_bytes, to_bytes

__all__ = [
    "MAX_DIFFERENCE_S",
    "Association",
    "BoolArray",
    "FloatArray",
    "IntArray",
    "Trajectory",
    "TrajectoryFormat",
    "associate",
    "associate_by_frame_id",
    "associate_by_name",
    "associate_by_timestamp",
    "association_of",
    "check_frame_ids",
    "from_bytes",
    "matched",
    "read_trajectory",
    "to_bytes",
    "write_kitti",
    "write_tum",
]
