"""Say how many frames a run must register: nearly as many as under the nominal setting."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from gtf_tune.trajectory.alignment import MIN_MATCHED

LEAST_COMMON = 0.5
"""Part of the frames of the shorter of two runs that both must have registered."""

LOST_BELOW = 0.5
"""Share of the median coverage below which a nominal run has lost the sequence and sets no example."""

_MOST_DIGITS = 6


@dataclass(frozen=True)
class CoverageFloor:
    """Hold the least coverage, a fraction of the frames, that clean and noisy runs must reach."""

    clean: float
    noisy: float

    def at_least(self, other: "CoverageFloor") -> "CoverageFloor":
        """Return the higher of two floors, of each kind."""
        return CoverageFloor(max(self.clean, other.clean), max(self.noisy, other.noisy))


def least_floor(num_frames: int) -> CoverageFloor:
    """Return the floor of the nominal setting itself: the frames that an alignment needs."""
    return CoverageFloor(MIN_MATCHED / num_frames, MIN_MATCHED / num_frames)


def coverage_floor(clean: Sequence[float], noisy: Sequence[float], share: float) -> CoverageFloor:
    """Return the floor that the coverages of nominal's runs set: ``share`` of the least of each kind.

    Clean runs go by clean ones and noisy runs by noisy ones, so that nominal itself reaches the floor. Runs that failed
    or lost more than half of what others register set no example: one bad run must not open the door to settings that
    drop frames. Where no run of a kind worked, the other kind counts.
    """
    by_kind = [_dependable(one) for one in (clean, noisy)]
    known = [one for one in by_kind if one is not None]
    if not known:
        return CoverageFloor(0.0, 0.0)
    return CoverageFloor(*(share * (min(known) if one is None else one) for one in by_kind))


def below(share: float, wanted: float) -> tuple[str, str]:
    """Return a share of frames and the larger one that was wanted in per cent, with the digits that tell them apart."""
    both = [(f"{share:.{digits}%}", f"{wanted:.{digits}%}") for digits in range(_MOST_DIGITS + 1)]
    return next((one for one in both if one[0] != one[1]), both[-1])


def _dependable(coverages: Sequence[float]) -> float | None:
    """Return the least coverage of runs that did not lose the sequence; None where none worked."""
    worked = [one for one in coverages if one > 0]
    if not worked:
        return None
    return min(one for one in worked if one >= LOST_BELOW * float(np.median(worked)))
