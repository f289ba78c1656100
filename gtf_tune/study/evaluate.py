"""Score one configuration on one sequence, without a study."""

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import Any

from gtf_tune.definition import GtfDefinition, LimitsDefinition, SideMetricDefinition
from gtf_tune.errors import TrajectoryError
from gtf_tune.execution import Executor, RunLimits
from gtf_tune.pipelines import OptionValue, Pipeline, with_focal_prior
from gtf_tune.pipelines.run import RunOutcome, RunRequest
from gtf_tune.sequence import Sequence
from gtf_tune.store.database import Database
from gtf_tune.study.events import Event, RunFinished
from gtf_tune.study.ground_truth.record import side_metric
from gtf_tune.study.noise.choice import ObtainRuns, choose_noise, fresh_runs, stored_runs
from gtf_tune.study.runs.plan import RunPlanner, SeedSource, run_order
from gtf_tune.study.runs.run_source import RunSource, SequenceRuns, run_limits
from gtf_tune.study.runs.stop import StopRequest
from gtf_tune.study.scoring.objective import SequenceScore, least_floor, score_sequence


@dataclass(frozen=True)
class Configuration:
    """What is scored: a pipeline, its options, how the score is formed, the seed and the limits of a run.

    ``side_metric`` is the error against ground truth that is shown beside the score.
    """

    pipeline: Pipeline
    options: Mapping[str, OptionValue]
    gtf: GtfDefinition
    seed: int = 0
    limits: LimitsDefinition = field(default_factory=LimitsDefinition)
    side_metric: SideMetricDefinition = field(default_factory=SideMetricDefinition)


@dataclass(frozen=True)
class Evaluation:
    """Score of a configuration on a sequence; ``side_metric`` is NaN without ground truth."""

    score: SequenceScore
    side_metric: float
    side_definition: SideMetricDefinition = field(default_factory=SideMetricDefinition)
    any_run_worked: bool = True

    @property
    def value(self) -> float:
        """The score; NaN where there is none."""
        return self.score.score.value if self.score.score else math.nan

    @property
    def interval(self) -> tuple[float, float]:
        """The 95 % confidence interval of the score; NaN where there is none."""
        return self.score.score.confidence_interval if self.score.score else (math.nan, math.nan)

    def as_dict(self) -> dict[str, Any]:
        """Return the numbers by name."""
        score = self.score.score
        return {
            "gtf_ate": score.value if score else None,
            "standard_error": score.standard_error if score else None,
            "confidence_interval": list(score.confidence_interval) if score else None,
            "matrix": score.matrix.tolist() if score else None,
            "collapse_rate": score.collapse_rate if score else None,
            "coverage": self.score.coverage,
            "feasible": self.score.feasible,
            "message": self.score.message,
            self.side_definition.key: self.side_metric,
            "side_metric": self.side_definition.model_dump(mode="json"),
        }


def evaluate_configuration(
    configuration: Configuration,
    sequence: Sequence,
    executor: Executor,
    on_run: Callable[[str], None] = lambda _: None,
    database: Database | None = None,
) -> Evaluation:
    """Return the score of a configuration; ``on_run`` gets a sentence for every run that ended.

    With a ``database`` runs are stored as they end, and those that it has are not made again. A configuration is
    infeasible here only if fewer than four frames are registered: there is no nominal run to compare with.
    """
    gtf = configuration.gtf
    sequence = with_focal_prior(sequence, configuration.pipeline)
    planner = RunPlanner(configuration.pipeline, gtf, SeedSource(configuration.seed), {})
    obtain = _way_to_obtain(executor, run_limits(configuration.limits), on_run, database)
    order = run_order(gtf.clean_runs, gtf.noisy_runs_max)
    sigma = gtf.noise_sigma
    if isinstance(sigma, str):
        sigma, reason = choose_noise(sequence, obtain, planner, configuration.options)
        on_run(f"noise of {sequence.name}: {sigma:g} grey levels ({reason})")
    runs = obtain([planner.request(sequence, configuration.options, run, sigma=sigma, number=0) for run in order])
    score = score_sequence(runs, least_floor(len(sequence)), gtf)
    error = _true_error(sequence, runs, configuration.side_metric)
    return Evaluation(score, error, configuration.side_metric, any(map(len, (*runs.clean, *runs.noisy))))


def _way_to_obtain(
    executor: Executor, limits: RunLimits, on_run: Callable[[str], None], database: Database | None
) -> ObtainRuns:
    def describe(request: RunRequest, outcome: RunOutcome) -> None:
        found = outcome.error or f"{len(outcome.trajectory)} frames, {outcome.wall_s:.1f} s"
        on_run(f"{request.kind} run {request.index}: {found}")

    def describe_stored(event: Event) -> None:
        if isinstance(event, RunFinished):
            request, stored = event.run.request, event.run.stored
            took = "reused" if event.run.reused else f"{stored.wall_s:.1f} s"
            on_run(f"{request.kind} run {request.index}: {stored.error or f'{stored.num_poses} frames, {took}'}")

    if database is None:
        return fresh_runs(executor, limits, describe)
    return stored_runs(RunSource(database, executor, limits, StopRequest(), describe_stored))


def _true_error(sequence: Sequence, runs: SequenceRuns, definition: SideMetricDefinition) -> float:
    if sequence.ground_truth is None:
        return math.nan
    try:
        return side_metric(sequence.ground_truth, runs.clean, definition).value
    except TrajectoryError:
        return math.nan
