"""Say which error of a pair of trajectories is meant."""

from dataclasses import dataclass
from typing import Literal

from gtf_tune.alignment import AlignmentKind
from gtf_tune.errors import TrajectoryError

RpeRelation = Literal["translation", "rotation"]
DeltaUnit = Literal["frames", "metres", "seconds"]
PosePairs = Literal["all", "consecutive"]


@dataclass(frozen=True)
class AteSettings:
    """Choose the absolute trajectory error: RMSE of positions after alignment."""

    alignment: AlignmentKind = "sim3"


@dataclass(frozen=True)
class RpeSettings:
    """Choose the relative pose error: RMSE over pairs of poses that lie ``delta`` apart.

    Attributes
    ----------
    relation
        ``translation`` in the unit of the first trajectory, or ``rotation`` in degrees.
    delta, delta_unit
        Distance of the two poses: in matched ``frames``, in ``metres`` of path along the aligned second trajectory, or
        in ``seconds`` of the first one's timestamps.
    pairs
        ``all`` starts a pair at every pose, ``consecutive`` where the last pair ended.
    alignment
        Done before; only its scale matters to relative poses.
    tolerance
        Share of ``delta`` in metres or seconds by which a pair of ``all`` may miss it.
    """

    relation: RpeRelation = "translation"
    delta: float = 1.0
    delta_unit: DeltaUnit = "frames"
    pairs: PosePairs = "all"
    alignment: AlignmentKind = "sim3"
    tolerance: float = 0.1

    def __post_init__(self) -> None:
        if not 0 < self.delta < float("inf"):
            raise TrajectoryError(f"expected a positive delta between poses, not {self.delta:g}")
        if self.delta_unit == "frames" and self.delta != int(self.delta):
            raise TrajectoryError(f"expected a whole number of frames between poses, not {self.delta:g}")


MetricSettings = AteSettings | RpeSettings
