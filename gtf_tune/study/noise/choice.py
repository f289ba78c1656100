"""Choose the noise: strong enough to show above run-to-run differences, weak enough for a linear response.

Small image noise moves the trajectory in proportion to its sigma (paper, section "The linearity assumption"), on top of
what runs differ by anyway, and independent causes add up in squares:

    score^2 = floor^2 + (response * sigma)^2

The floor is the score of clean runs against other clean runs. Where noise is too strong, reconstructions degrade or
collapse and the response per grey level is no longer constant.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from gtf_tune.errors import TrajectoryError
from gtf_tune.trajectory import FloatArray

LADDER = (0.5, 1.0, 2.0, 3.0, 5.0, 8.0)
"""Grey levels that are tried by default."""

LINEAR_WITHIN = 0.3
"""Largest deviation, as a logarithm, of the response per grey level from that of the weaker noise."""

VISIBLE_FROM = 1.5
"""Times the floor from which on a score says something about noise."""

GOOD_ENOUGH = 0.9
"""Share of the best signal-to-spread ratio that a weaker noise needs to be preferred."""

_CONTRADICTION = 3.0
"""Times the score of some noise from which on a floor contradicts it: noise adds to what runs differ by."""

_FEWEST_FOR_FIT = 3


@dataclass(frozen=True)
class NoiseLevel:
    """Runs with noise of one sigma.

    ``score`` is the geometric mean over noise instances, ``spread`` the standard deviation of their logarithms; NaN
    where runs failed. ``collapsed`` counts runs that fell apart, ``failed`` those without a usable trajectory.
    """

    sigma: float
    score: float
    spread: float
    runs: int
    collapsed: int = 0
    failed: int = 0
    coverage: float = 1.0

    @property
    def is_sound(self) -> bool:
        """Whether every run worked."""
        return not self.collapsed and not self.failed and math.isfinite(self.score)


@dataclass(frozen=True)
class Line:
    """Straight line fitted by least squares, and the share of the variance that it explains.

    ``r_squared`` is NaN for fewer than three points: a line through two of them explains everything and says nothing.
    """

    slope: float
    intercept: float
    r_squared: float


@dataclass(frozen=True)
class NoiseScale:
    """Ladder of noise levels with what follows from it.

    ``responses`` (per grey level) and ``ratios`` (signal over run-to-run spread) belong to the levels, NaN where the
    score does not rise above the floor. ``linear`` says which levels are in the linear range. The two lines are fitted
    there: score against sigma, and score^2 against sigma^2.
    """

    floor: NoiseLevel
    levels: tuple[NoiseLevel, ...]
    responses: tuple[float, ...]
    ratios: tuple[float, ...]
    linear: tuple[bool, ...]
    score_line: Line
    square_line: Line
    recommended: float
    reason: str


def noise_scale(floor: NoiseLevel, levels: Sequence[NoiseLevel]) -> NoiseScale:
    """Return what a ladder says; ``floor`` is the level of sigma 0, ``levels`` rise.

    The recommended sigma is the weakest one whose ratio of signal to spread comes within a tenth of the best, among
    levels in the linear range without a collapsed run. A floor far above the score of some noise says nothing: most of
    the clean runs behind it fell apart, where those with noise did not.

    Raises
    ------
    TrajectoryError
        There is no level, or none on which every run works.
    """
    base = _believed(floor, levels)
    responses = [_response(one, base) for one in levels]
    ratios = [_ratio(one, base) for one in levels]
    linear = _linear_range(levels, responses)
    chosen, reason = _recommend(levels, ratios, linear)
    if base is not floor:
        reason += "; clean runs differ by more than noisy ones, so most of them fell apart and tell no floor"
    points = [(one.sigma, one.score) for one, inside in zip([base, *levels], [True, *linear], strict=True) if inside]
    known = np.array([point for point in points if math.isfinite(point[1])]).reshape(-1, 2)
    return NoiseScale(
        floor=floor,
        levels=tuple(levels),
        responses=tuple(responses),
        ratios=tuple(ratios),
        linear=tuple(linear),
        score_line=_fit(known[:, 0], known[:, 1]),
        square_line=_fit(known[:, 0] ** 2, known[:, 1] ** 2),
        recommended=chosen.sigma,
        reason=reason,
    )


def is_open(floor: NoiseLevel, levels: Sequence[NoiseLevel]) -> bool:
    """Return True if stronger noise may change the recommendation: the linear range has not begun or not ended."""
    base = _believed(floor, levels)
    linear = _linear_range(levels, [_response(one, base) for one in levels])
    return not any(linear) or linear[-1]


def _believed(floor: NoiseLevel, levels: Sequence[NoiseLevel]) -> NoiseLevel:
    """Return the floor, without its score where that contradicts those of the levels."""
    least = min((one.score for one in levels if one.is_sound), default=math.inf)
    return replace(floor, score=math.nan) if floor.score > _CONTRADICTION * least else floor


def _signal(level: NoiseLevel, floor: NoiseLevel) -> float:
    """Return the part of the score that noise causes, NaN where it does not show."""
    base = floor.score if math.isfinite(floor.score) else 0.0
    if not level.score > VISIBLE_FROM * base:
        return math.nan
    return math.sqrt(level.score**2 - base**2)


def _response(level: NoiseLevel, floor: NoiseLevel) -> float:
    return _signal(level, floor) / level.sigma


def _ratio(level: NoiseLevel, floor: NoiseLevel) -> float:
    """Return the signal over the standard deviation of an instance's score."""
    spread = level.spread * level.score
    return _signal(level, floor) / spread if spread > 0 else math.nan


def _linear_range(levels: Sequence[NoiseLevel], responses: Sequence[float]) -> list[bool]:
    """Return which levels are linear: from the weakest visible one on, until the response changes or a run fails."""
    inside: list[bool] = []
    logs: list[float] = []
    ended = False
    for level, response in zip(levels, responses, strict=True):
        visible = math.isfinite(response)
        deviates = bool(logs) and visible and abs(math.log(response) - float(np.mean(logs))) > LINEAR_WITHIN
        # A run that fell apart under the weakest noise is bad luck: stronger noise shows whether the response holds.
        ended = ended or deviates or (bool(logs) and not level.is_sound)
        inside.append(visible and level.is_sound and not ended)
        if inside[-1]:
            logs.append(math.log(response))
    return inside


def _recommend(levels: Sequence[NoiseLevel], ratios: Sequence[float], linear: Sequence[bool]) -> tuple[NoiseLevel, str]:
    good = [(one, ratio) for one, ratio, inside in zip(levels, ratios, linear, strict=True) if inside]
    known = [(one, ratio) for one, ratio in good if math.isfinite(ratio)]
    if known:
        best = max(ratio for _, ratio in known)
        chosen = next(one for one, ratio in known if ratio >= GOOD_ENOUGH * best)
        return chosen, "the weakest noise with nearly the best ratio of signal to spread in the linear range"
    if good:
        return good[0][0], "the only noise in the linear range"
    sound = [one for one in levels if one.is_sound]
    visible = [one for one, ratio in zip(levels, ratios, strict=True) if one.is_sound and not math.isnan(ratio)]
    if visible:
        return visible[0], "the weakest noise that shows above run-to-run differences and leaves every run intact"
    if sound:
        return sound[-1], "the strongest noise without a failed run; it does not show above run-to-run differences"
    raise TrajectoryError(
        "no level of noise leaves every run intact, so none can be recommended; try weaker ones, or options that "
        "reconstruct this sequence more reliably"
    )


def _fit(x: FloatArray, y: FloatArray) -> Line:
    if len(x) < 2 or float(np.ptp(x)) == 0:
        return Line(math.nan, math.nan, math.nan)
    slope, intercept = np.polyfit(x, y, 1)
    total = float(((y - y.mean()) ** 2).sum())
    rest = float(((y - slope * x - intercept) ** 2).sum())
    told = total > 0 and len(x) >= _FEWEST_FOR_FIT
    return Line(float(slope), float(intercept), 1 - rest / total if told else math.nan)
