"""Choose the noise of a study by its own first runs: the weakest that shows above what clean runs differ by."""

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from gtf_tune.definition import GtfDefinition
from gtf_tune.execution import Executor, RunLimits
from gtf_tune.gtf import gtf_score
from gtf_tune.pipelines import OptionValue
from gtf_tune.pipelines.run import RunOutcome, RunRequest
from gtf_tune.sequence import Sequence as ImageSequence
from gtf_tune.store import studies
from gtf_tune.study.events import NoiseChosen, NoiseStarted
from gtf_tune.study.open_study import OpenStudy
from gtf_tune.study.runs.plan import RunPlanner, SeedSource, run_order
from gtf_tune.study.runs.run_source import RunSource, SequenceRuns, failed_key, finished_by_sequence, sequence_runs
from gtf_tune.study.scoring.objective import settings_of
from gtf_tune.trajectory import Trajectory

STEPS = (0.5, 1.0, 2.0, 3.0, 5.0)
"""Grey levels that are tried, the first of which usually serves."""

VISIBLE_FROM = 1.5
"""Times the floor from which on a score says something about noise."""

CONTRADICTION = 3.0
"""Times the score of some noise from which on a floor contradicts it: noise adds to what runs differ by."""

_NOISY_RUNS = 3
_CLEAN_RUNS = 2

ObtainRuns = Callable[[Sequence[RunRequest]], SequenceRuns]
"""Return the runs of one sequence, given their requests."""


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


def level_of(sigma: float, runs: SequenceRuns, gtf: GtfDefinition) -> NoiseLevel:
    """Return what runs of one sequence say about the noise of one sigma."""
    # Instances are compared with each other here, and a geometric mean does not let one of them decide.
    settings = replace(settings_of(gtf), aggregate="gmean")
    score = gtf_score(runs.clean, runs.noisy, settings, num_frames=runs.num_frames)
    values = score.instance_values
    floor = gtf.coverage_floor * float(score.coverage_clean.min())
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


def choose_noise(
    sequence: ImageSequence,
    obtain: ObtainRuns,
    planner: RunPlanner,
    options: Mapping[str, OptionValue],
) -> tuple[float, str]:
    """Return the noise of a sequence in grey levels, and the reason for it.

    It is the weakest noise whose score stands out from the floor, the error of clean runs of other seeds against each
    other. The runs are those that score these options anyway, but for the noisy ones of levels that are too weak.
    """
    gtf = planner.gtf
    noisy_runs = min(gtf.noisy_runs_min, _NOISY_RUNS)
    orders = [run_order(max(gtf.clean_runs, _CLEAN_RUNS), noisy_runs), *[run_order(0, noisy_runs)] * (len(STEPS) - 1)]
    clean: tuple[Trajectory, ...] = ()
    below = STEPS[0]
    for sigma, order in zip(STEPS, orders, strict=True):
        runs = obtain([planner.request(sequence, options, run, sigma=sigma, number=0) for run in order])
        clean = runs.clean or clean
        floor = level_of(0.0, replace(runs, clean=clean[:1], noisy=clean[1:]), gtf).score
        level = level_of(sigma, replace(runs, clean=clean[: gtf.clean_runs]), gtf)
        if not level.is_sound:
            return below, "stronger noise breaks runs" if sigma > STEPS[0] else "even the weakest noise breaks runs"
        if not level.score <= VISIBLE_FROM * floor:
            return sigma, "the weakest noise that shows above what clean runs differ by"
        if floor > CONTRADICTION * level.score:
            return sigma, "clean runs differ by more than noisy ones, which stronger noise would not change"
        below = sigma
    return STEPS[0], "no noise shows above what clean runs differ by, so the weakest serves as well"


def stored_runs(source: RunSource) -> ObtainRuns:
    """Return a way to obtain runs that reuses and stores them."""

    def obtain(requests: Sequence[RunRequest]) -> SequenceRuns:
        sequence = requests[0].sequence
        sigma = max(request.noise_sigma for request in requests)
        source.on_event(NoiseStarted(sequence.name, sigma, len(requests)))
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


def with_noise(
    study: OpenStudy, sequences: Mapping[str, ImageSequence], source: RunSource, purpose: str = "search"
) -> OpenStudy:
    """Return the study with a sigma for each of these sequences, chosen and stored where ``auto`` has none yet.

    The worker that has trial 0 chooses, by runs of nominal with the seeds of ``purpose``, while the others wait for
    that trial. Runs are stored as they end, so an interrupted choice goes on where it stopped.

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
    planner = RunPlanner(
        study.pipeline, definition.gtf, SeedSource(definition.search.seed, purpose), definition.fixed_options
    )
    measured = {}

    def obtain(requests: Sequence[RunRequest]) -> SequenceRuns:
        keys = [key for request in requests for key in (request.key, failed_key(request, source.limits))]
        studies.note_noise_runs(study.database, study.record.id, keys)
        return stored_runs(source)(requests)

    for name, sequence in missing.items():
        measured[name], reason = choose_noise(sequence, obtain, planner, study.space.nominal)
        source.on_event(NoiseChosen(name, measured[name], reason))
    return replace(study, sigmas=studies.resolve_noise(study.database, study.record.id, measured))
