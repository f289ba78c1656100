"""Find out whether the score of a study means anything: it says how nominal moves under noise, and must be small.

Where nominal's own trajectory falls apart or loses its frames under noise, a smaller score is no better trajectory: one
that shrinks to two points moves least of all. Then no other options are recommended.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from statistics import median
from typing import TYPE_CHECKING, Any, Self

from gtf_tune.definition import GtfDefinition

if TYPE_CHECKING:  # readers of what is stored need neither numpy nor scipy
    from gtf_tune.gtf import GtfScore

MOST_MOVEMENT = 0.1
"""Share of its extent that nominal's trajectory may move under noise."""

LEAST_KEPT = 0.9
"""Share of the frames of nominal's clean runs that its noisy runs must register."""

_MOST_DIVERGED = 0.5


@dataclass(frozen=True)
class NominalRuns:
    """What the runs of nominal on one sequence say about the score.

    Attributes
    ----------
    movement
        Median over pairs of runs, as a fraction of the extent; None where the score is no length or nothing is known.
    diverged
        Share of the noisy runs that collapsed or gave no error.
    clean_coverage, noisy_coverage
        Registered frames over all frames: the least of the clean runs, and the median of the noisy runs.
    """

    movement: float | None
    diverged: float
    clean_coverage: float
    noisy_coverage: float

    @classmethod
    def of_score(cls, score: "GtfScore") -> Self:
        """Return what fresh runs say."""
        failed = [all(value != value for value in column) for column in score.matrix.T.tolist()]
        lost = [bool(one) or bool(other) for one, other in zip(score.collapsed, failed, strict=True)]
        return cls(
            movement=movement(score),
            diverged=sum(lost) / len(lost),
            clean_coverage=float(score.coverage_clean.min()),
            noisy_coverage=median(score.coverage_noisy.tolist()),
        )

    @classmethod
    def of_detail(cls, detail: Mapping[str, Any], gtf: GtfDefinition) -> Self:
        """Return what is stored with the nominal trial for one sequence."""
        matrix = detail.get("matrix") or []
        unit = 1.0 if gtf.normalise == "extent" else detail.get("extent")
        flat = [value for row in matrix for value in row if value is not None]
        known = bool(flat) and bool(unit) and gtf.metric != "rpe_rotation"
        failed = [all(value is None for value in column) for column in zip(*matrix, strict=True)]
        collapsed = detail.get("collapsed") or [False] * len(failed)
        lost = [one or other for one, other in zip(collapsed, failed, strict=True)]
        return cls(
            movement=median(flat) / float(unit or 1.0) if known else None,
            diverged=sum(lost) / len(lost) if lost else 0.0,
            clean_coverage=float(detail["coverage_nominal"]),
            noisy_coverage=_noisy_coverage(detail),
        )

    @property
    def fault(self) -> str:
        """Why the score says little, in words; empty where it says something."""
        if self.diverged > _MOST_DIVERGED:
            return f"{self.diverged:.0%} of nominal's noisy runs diverged"
        if self.movement is not None and self.movement > MOST_MOVEMENT:
            return (
                f"nominal's own trajectory moves by {1000 * self.movement:.0f} per mille of its extent under noise, "
                f"more than {1000 * MOST_MOVEMENT:.0f}"
            )
        return _frames_lost(self.clean_coverage, self.noisy_coverage)


def movement(score: "GtfScore") -> float | None:
    """Return how far trajectories move under noise, the median over pairs of runs, as a fraction of the extent.

    None where the score is no length, or no pair could be measured.
    """
    unit = 1.0 if score.settings.is_relative else score.extent
    known = [value for row in (score.matrix / unit).tolist() for value in row if value == value]
    return median(known) if known and score.settings.metric != "rpe_rotation" else None


def doubts(runs: Mapping[str, NominalRuns]) -> tuple[str, ...]:
    """Return why the score says little, one sentence for each sequence where it does."""
    faults = {name: found.fault for name, found in runs.items()}
    return tuple(f"The score says little on {name}: {fault}." for name, fault in faults.items() if fault)


def doubts_of_scores(scores: "Mapping[str, GtfScore]", searched: Sequence[str]) -> tuple[str, ...]:
    """Return the doubts that fresh runs of nominal raise on the searched sequences."""
    return doubts({name: NominalRuns.of_score(scores[name]) for name in searched})


def doubts_of_detail(detail: Mapping[str, Any], gtf: GtfDefinition) -> tuple[str, ...]:
    """Return the doubts that the nominal trial of the search raises."""
    known = {name: found for name, found in detail.get("sequences", {}).items() if found.get("matrix")}
    return doubts({name: NominalRuns.of_detail(found, gtf) for name, found in known.items()})


def frames_lost_to_noise(detail: Mapping[str, Any]) -> str:
    """Return in words which frames noise costs the nominal trial on one sequence; empty where it keeps nearly all."""
    return _frames_lost(detail["coverage_nominal"], _noisy_coverage(detail))


def _noisy_coverage(detail: Mapping[str, Any]) -> float:
    return float(median(detail.get("coverage_noisy") or [detail["coverage"]]))


def _frames_lost(clean: float, noisy: float) -> str:
    if noisy >= LEAST_KEPT * clean:
        return ""
    return f"noise costs the nominal options frames ({clean:.0%} without it, {noisy:.0%} in the median noisy run)"
