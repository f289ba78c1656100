"""Which error of a pair of trajectories is meant."""

from dataclasses import dataclass
from typing import Literal, get_args

from gtf_tune.errors import DefinitionError
from gtf_tune.trajectory.alignment import ALIGNMENTS, AlignmentKind

RpeRelation = Literal["translation", "rotation"]
DeltaUnit = Literal["frames", "metres", "seconds"]
PosePairs = Literal["all", "consecutive"]


@dataclass(frozen=True)
class AteSettings:
    """The absolute trajectory error: RMSE of positions after alignment."""

    alignment: AlignmentKind = "sim3"

    def __post_init__(self) -> None:
        check_word("alignment", self.alignment, ALIGNMENTS)


@dataclass(frozen=True)
class RpeSettings:
    """The relative pose error: RMSE over pairs of poses that lie ``delta`` apart.

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

    Raises
    ------
    DefinitionError
        A word is unknown, or delta is not positive, or not whole where it counts frames.
    """

    relation: RpeRelation = "translation"
    delta: float = 1.0
    delta_unit: DeltaUnit = "frames"
    pairs: PosePairs = "all"
    alignment: AlignmentKind = "sim3"
    tolerance: float = 0.1

    def __post_init__(self) -> None:
        check_word("relation", self.relation, get_args(RpeRelation))
        check_word("unit of delta", self.delta_unit, get_args(DeltaUnit))
        check_word("choice of pose pairs", self.pairs, get_args(PosePairs))
        check_word("alignment", self.alignment, ALIGNMENTS)
        if not 0 < self.delta < float("inf"):
            raise DefinitionError(f"expected a positive delta between poses, not {self.delta:g}")
        if self.delta_unit == "frames" and self.delta != int(self.delta):
            raise DefinitionError(f"expected a whole number of frames between poses, not {self.delta:g}")


MetricSettings = AteSettings | RpeSettings


def check_word(name: str, word: str, known: tuple[str, ...]) -> None:
    """Raise an error for a word that is not among the known ones.

    Raises
    ------
    DefinitionError
        The word is unknown.
    """
    if word not in known:
        raise DefinitionError(f"expected as {name} one of {', '.join(known)}, not '{word}'")
