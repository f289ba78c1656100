"""Choose by what the poses of trajectories belong together: image names, timestamps, or frame ids."""

from collections.abc import Sequence
from typing import Literal

from gtf_tune.errors import TrajectoryError
from gtf_tune.trajectory.matching import (
    Matches,
    associate_by_frame_id,
    associate_by_name,
    associate_by_timestamp,
    check_frame_ids,
)
from gtf_tune.trajectory.value import Trajectory

Association = Literal["name", "timestamp", "frame id", "order"]
"""What poses are associated by; ``order`` are frame ids that only count the poses of files, all with as many."""

MAX_DIFFERENCE_S = 0.01
"""How far apart two timestamps may be to belong together, in seconds: evo's default."""


def association_of(trajectories: Sequence[Trajectory]) -> Association:
    """Return by what the poses of all these trajectories can be associated.

    This is the image name where all have names, else the timestamp where all have timestamps, else the frame id.
    Trajectories without poses are left out.

    Raises
    ------
    TrajectoryError
        Nothing says which poses belong together: some have neither names nor timestamps, and their numbers of poses
        differ, or others of them are files with timestamps.
    """
    filled = [trajectory for trajectory in trajectories if len(trajectory)]
    if all(trajectory.names for trajectory in filled):
        return "name"
    if all(trajectory.has_timestamps for trajectory in filled):
        return "timestamp"
    check_frame_ids(filled)
    timed = [trajectory for trajectory in filled if trajectory.has_timestamps]
    if any(trajectory.ids_are_counted for trajectory in timed):
        raise TrajectoryError(
            "expected timestamps in all trajectories, or in none, but some have only lines or image names; give those "
            "with timestamps, as TUM files have them"
        )
    return "order" if any(trajectory.ids_are_counted for trajectory in filled) else "frame id"


def associate(
    a: Trajectory,
    b: Trajectory,
    association: Association,
    max_difference_s: float = MAX_DIFFERENCE_S,
    offset_s: float = 0.0,
) -> Matches:
    """Return indices (m,) into a and (m,) into b of the poses that belong together, in order.

    Parameters
    ----------
    association
        As `association_of` returns it for both.
    max_difference_s
        How far apart two timestamps may be, in seconds; not read by the other associations.
    offset_s
        What is added to the timestamps of b first; not read by the other associations.

    Raises
    ------
    TrajectoryError
        Names are missing or repeated, timestamps do not increase, or counted frame ids differ.
    """
    if association == "name":
        return associate_by_name(a, b)
    if association == "timestamp":
        return associate_by_timestamp(a, b, max_difference_s, offset_s)
    return associate_by_frame_id(a, b)
