"""Measure a ladder of noise levels on a sequence, for ``gtf-tune noise``."""

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from gtf_tune.definition import GtfDefinition
from gtf_tune.errors import TrajectoryError
from gtf_tune.pipelines import OptionValue, Pipeline
from gtf_tune.pipelines.run import RunKind, RunRequest
from gtf_tune.sequence import Sequence as ImageSequence
from gtf_tune.study.noise.choice import CONTRADICTION, VISIBLE_FROM, NoiseLevel, ObtainRuns, level_of
from gtf_tune.study.runs.plan import RunPlanner, SeedSource, run_order
from gtf_tune.study.runs.run_source import SequenceRuns
from gtf_tune.trajectory import FloatArray
from gtf_tune.trajectory.alignment import MIN_MATCHED

LADDER = (0.5, 1.0, 2.0, 3.0, 5.0, 8.0)
"""Grey levels that are tried by default."""

LINEAR_WITHIN = 0.3
"""Largest deviation, as a logarithm, of the response per grey level from that of the weaker noise."""

GOOD_ENOUGH = 0.9
"""Share of the best signal-to-spread ratio that a weaker noise needs to be preferred."""

_FEWEST_FOR_FIT = 3


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
    responses = [_response(level, base) for level in levels]
    ratios = [_ratio(level, base) for level in levels]
    linear = _linear_range(levels, responses)
    chosen, reason = _recommend(levels, ratios, linear)
    if base is not floor:
        reason += "; clean runs differ by more than noisy ones, so most of them fell apart and give no floor"
    points = [(one.sigma, one.score) for one, inside in zip([base, *levels], [True, *linear], strict=True) if inside]
    known = np.array([point for point in points if math.isfinite(point[1])]).reshape(-1, 2)
    return NoiseScale(
        floor=floor,
        levels=tuple(levels),
        responses=tuple(responses),
        ratios=tuple(ratios),
        linear=tuple(linear),
        score_line=fit_line(known[:, 0], known[:, 1]),
        square_line=fit_line(known[:, 0] ** 2, known[:, 1] ** 2),
        recommended=chosen.sigma,
        reason=reason,
    )


def _believed(floor: NoiseLevel, levels: Sequence[NoiseLevel]) -> NoiseLevel:
    """Return the floor, without its score where that contradicts those of the levels."""
    least = min((level.score for level in levels if level.is_sound), default=math.inf)
    return replace(floor, score=math.nan) if floor.score > CONTRADICTION * least else floor


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
    sound = [level for level in levels if level.is_sound]
    visible = [one for one, ratio in zip(levels, ratios, strict=True) if one.is_sound and not math.isnan(ratio)]
    if visible:
        return visible[0], "the weakest noise that shows above run-to-run differences and leaves every run intact"
    if sound:
        return sound[-1], "the strongest noise without a failed run; it does not show above run-to-run differences"
    raise TrajectoryError(
        "no level of noise leaves every run intact, so none can be recommended; try weaker ones, or options that "
        "reconstruct this sequence more reliably"
    )


def fit_line(x: FloatArray, y: FloatArray) -> Line:
    """Return the least-squares line through points, (n,) each; NaN where fewer than two differ in x."""
    if len(x) < 2 or float(np.ptp(x)) == 0:
        return Line(math.nan, math.nan, math.nan)
    slope, intercept = np.polyfit(x, y, 1)
    total = float(((y - y.mean()) ** 2).sum())
    rest = float(((y - slope * x - intercept) ** 2).sum())
    told = total > 0 and len(x) >= _FEWEST_FOR_FIT
    return Line(float(slope), float(intercept), 1 - rest / total if told else math.nan)


DEFAULT_RUNS = 4
PURPOSE = "noise"


@dataclass(frozen=True)
class NoiseProbe:
    """What is measured: nominal options (and fixed ones) of a pipeline, ``runs`` noisy runs on each level.

    All levels see the same noise patterns, scaled, so that their scores differ by sigma only.
    """

    pipeline: Pipeline
    options: Mapping[str, OptionValue]
    gtf: GtfDefinition
    seed: int = 0
    runs: int = DEFAULT_RUNS
    ladder: tuple[float, ...] = LADDER

    def measure(
        self,
        sequence: ImageSequence,
        obtain: ObtainRuns,
        on_level: Callable[[NoiseLevel], None] = lambda _: None,
    ) -> NoiseScale:
        """Return the scale of a sequence; ``on_level`` gets each level, and no level follows one with failed runs.

        Raises
        ------
        TrajectoryError
            Every run fails without noise already, or even the weakest noise breaks runs.
        """
        k = self.gtf.clean_runs
        found = obtain(self._requests(sequence, run_order(k + self.runs, 0), 0.0))
        _require_any(found, sequence)
        clean = found.clean[:k]
        floor = level_of(0.0, replace(found, clean=clean, noisy=found.clean[k:]), self.gtf)
        on_level(floor)
        levels: list[NoiseLevel] = []
        for sigma in self.ladder:
            noisy = obtain(self._requests(sequence, run_order(0, self.runs), sigma))
            levels.append(level_of(sigma, replace(noisy, clean=clean), self.gtf))
            on_level(levels[-1])
            if levels[-1].failed:
                break
        return noise_scale(floor, levels)

    def _requests(self, sequence: ImageSequence, runs: Sequence[tuple[RunKind, int]], sigma: float) -> list[RunRequest]:
        common = self.gtf.model_copy(update={"common_noise": True})
        planner = RunPlanner(self.pipeline, common, SeedSource(self.seed, PURPOSE), self.options)
        return [planner.request(sequence, {}, run, sigma=sigma, number=0) for run in runs]


def _require_any(runs: SequenceRuns, sequence: ImageSequence) -> None:
    """Raise `TrajectoryError` with the error of the first clean run where none of them has poses to compare."""
    if any(len(run) >= MIN_MATCHED for run in runs.clean):
        return
    first = runs.clean[0]
    failed = not len(first) and runs.errors
    reason = runs.errors[0] if failed else f"it registered {len(first)} of {len(sequence)} frames"
    raise TrajectoryError(
        f"every run on {sequence.name} fails without noise already, so none can be recommended; the first one: {reason}"
    )
