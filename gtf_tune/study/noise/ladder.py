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
from gtf_tune.study.noise.choice import LADDER, NoiseLevel, NoiseScale, is_open, noise_scale
from gtf_tune.study.open_study import OpenStudy
from gtf_tune.study.runs.plan import RunPlanner, SeedSource, run_order
from gtf_tune.study.runs.run_source import RunSource
from gtf_tune.study.runs.sequence_runs import SequenceRuns, finished_by_sequence, sequence_runs
from gtf_tune.study.scoring.objective import settings_of
from gtf_tune.trajectory.alignment import MIN_MATCHED

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
    for name, sequence in missing.items():
        measured[name], reason = probe.choose(sequence, stored_runs(source))
        source.on_event(NoiseChosen(name, measured[name], reason))
    return replace(study, sigmas=studies.resolve_noise(study.database, study.record.id, measured))
