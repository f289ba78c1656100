"""Measure a ladder of noise levels on a sequence, for ``gtf-tune noise`` and for ``noise_sigma = "auto"``."""

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from gtf_tune.definition import GtfDefinition
from gtf_tune.errors import TrajectoryError
from gtf_tune.execution import Executor, RunLimits
from gtf_tune.gtf import gtf_score
from gtf_tune.pipelines import OptionValue, Pipeline
from gtf_tune.pipelines.run import RunKind, RunOutcome, RunRequest
from gtf_tune.sequence import Sequence as ImageSequence
from gtf_tune.store import studies
from gtf_tune.study.events import NoiseChosen, NoiseStarted
from gtf_tune.study.open_study import OpenStudy
from gtf_tune.study.runs.plan import RunPlanner, SeedSource, run_order
from gtf_tune.study.runs.run_source import (
    RunSource,
    SequenceRuns,
    failed_key,
    finished_by_sequence,
    sequence_runs,
)
from gtf_tune.study.scoring.objective import settings_of
from gtf_tune.trajectory import FloatArray
from gtf_tune.trajectory.alignment import MIN_MATCHED

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
        score_line=_fit(known[:, 0], known[:, 1]),
        square_line=_fit(known[:, 0] ** 2, known[:, 1] ** 2),
        recommended=chosen.sigma,
        reason=reason,
    )


def is_open(floor: NoiseLevel, levels: Sequence[NoiseLevel]) -> bool:
    """Return True if stronger noise may change the recommendation: the linear range has not begun or not ended."""
    base = _believed(floor, levels)
    linear = _linear_range(levels, [_response(level, base) for level in levels])
    return not any(linear) or linear[-1]


def _believed(floor: NoiseLevel, levels: Sequence[NoiseLevel]) -> NoiseLevel:
    """Return the floor, without its score where that contradicts those of the levels."""
    least = min((level.score for level in levels if level.is_sound), default=math.inf)
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


def _fit(x: FloatArray, y: FloatArray) -> Line:
    if len(x) < 2 or float(np.ptp(x)) == 0:
        return Line(math.nan, math.nan, math.nan)
    slope, intercept = np.polyfit(x, y, 1)
    total = float(((y - y.mean()) ** 2).sum())
    rest = float(((y - slope * x - intercept) ** 2).sum())
    told = total > 0 and len(x) >= _FEWEST_FOR_FIT
    return Line(float(slope), float(intercept), 1 - rest / total if told else math.nan)


DEFAULT_RUNS = 4
PURPOSE = "noise"

ObtainRuns = Callable[[Sequence[RunRequest]], SequenceRuns]
"""Return the runs of one sequence, given their requests."""


@dataclass(frozen=True)
class NoiseProbe:
    """What is measured: nominal options (and fixed ones) of a pipeline, ``runs`` noisy runs on each level.

    All levels see the same noise patterns, scaled, so that their scores differ by sigma only. Unless ``whole``, the
    ladder ends where stronger noise cannot change the recommendation.
    """

    pipeline: Pipeline
    options: Mapping[str, OptionValue]
    gtf: GtfDefinition
    seed: int = 0
    runs: int = DEFAULT_RUNS
    ladder: tuple[float, ...] = LADDER
    whole: bool = True

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
        floor = self._level(0.0, replace(found, clean=clean, noisy=found.clean[k:]))
        on_level(floor)
        levels: list[NoiseLevel] = []
        for sigma in self.ladder:
            noisy = obtain(self._requests(sequence, run_order(0, self.runs), sigma))
            levels.append(self._level(sigma, replace(noisy, clean=clean)))
            on_level(levels[-1])
            if levels[-1].failed or not (self.whole or is_open(floor, levels)):
                break
        return noise_scale(floor, levels)

    def choose(self, sequence: ImageSequence, obtain: ObtainRuns) -> tuple[float, str]:
        """Return the recommended sigma and the reason for it.

        It is the weakest of the ladder where these options fail, or every noise breaks runs: others may still work.
        """
        try:
            scale = self.measure(sequence, obtain)
        except TrajectoryError as error:
            return min(self.ladder), str(error)
        return scale.recommended, scale.reason

    def _requests(self, sequence: ImageSequence, runs: Sequence[tuple[RunKind, int]], sigma: float) -> list[RunRequest]:
        common = self.gtf.model_copy(update={"common_noise": True})
        planner = RunPlanner(self.pipeline, common, SeedSource(self.seed, PURPOSE), self.options)
        return [planner.request(sequence, {}, run, sigma=sigma, number=0) for run in runs]

    def _level(self, sigma: float, runs: SequenceRuns) -> NoiseLevel:
        # Instances are compared with each other here, and a geometric mean does not let one of them decide.
        settings = replace(settings_of(self.gtf), aggregate="gmean")
        score = gtf_score(runs.clean, runs.noisy, settings, num_frames=runs.num_frames)
        values = score.instance_values
        floor = self.gtf.coverage_floor * float(score.coverage_clean.min())
        failed = np.isnan(values) | (score.coverage_noisy < floor)
        known = values[~failed & (values > 0)]
        return NoiseLevel(
            sigma=sigma,
            score=score.value,
            spread=float(np.log(known).std(ddof=1)) if len(known) > 1 else math.nan,
            runs=len(runs.noisy),
            collapsed=int(score.collapsed.sum()),
            failed=int(failed.sum()),
            coverage=float(score.coverage_noisy.min()),
        )


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


def stored_runs(source: RunSource) -> ObtainRuns:
    """Return a way to obtain runs that reuses and stores them."""

    def obtain(requests: Sequence[RunRequest]) -> SequenceRuns:
        sequence = requests[0].sequence
        source.on_event(NoiseStarted(sequence.name, requests[0].noise_sigma, len(requests)))
        return finished_by_sequence(source.obtain(requests))[sequence.name]

    return obtain


def fresh_runs(
    executor: Executor,
    limits: RunLimits,
    on_run: Callable[[RunRequest, RunOutcome], None] = lambda request, outcome: None,
) -> ObtainRuns:
    """Return a way to obtain runs that stores nothing; ``on_run`` gets each run as it ends."""

    def obtain(requests: Sequence[RunRequest]) -> SequenceRuns:
        found = []
        for request, future in [(request, executor.submit(request, limits)) for request in requests]:
            outcome = future.result()
            outcome.raise_for_machine()
            on_run(request, outcome)
            found.append((request.kind, outcome.trajectory, outcome.error))
        return sequence_runs(found, len(requests[0].sequence))

    return obtain


def with_noise(study: OpenStudy, sequences: Mapping[str, ImageSequence], source: RunSource) -> OpenStudy:
    """Return the study with a sigma for each of these sequences, measured and stored where ``auto`` has none yet.

    The worker that has trial 0 measures, while the others wait for that trial. Runs are stored as they end, so an
    interrupted measurement goes on where it stopped.

    Raises
    ------
    Interrupted
        Someone asked to stop.
    """
    if not set(sequences) - set(study.sigmas):
        return study
    stored = studies.get(study.database, study.definition.name).resolved["noise_sigma"]
    missing = {name: sequence for name, sequence in sequences.items() if name not in stored}
    definition = study.definition
    nominal = {**definition.fixed_options, **study.space.nominal}
    probe = NoiseProbe(study.pipeline, nominal, definition.gtf, definition.search.seed, whole=False)
    measured = {}

    def obtain(requests: Sequence[RunRequest]) -> SequenceRuns:
        keys = [key for request in requests for key in (request.key, failed_key(request, source.limits))]
        studies.note_noise_runs(study.database, study.record.id, keys)
        return stored_runs(source)(requests)

    for name, sequence in missing.items():
        measured[name], reason = probe.choose(sequence, obtain)
        source.on_event(NoiseChosen(name, measured[name], reason))
    return replace(study, sigmas=studies.resolve_noise(study.database, study.record.id, measured))
