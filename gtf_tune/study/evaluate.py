"""Score one configuration on one sequence, without a study and without a database."""

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import Any

from gtf_tune.definition import GtfDefinition, LimitsDefinition, SideMetricDefinition
from gtf_tune.errors import TrajectoryError
from gtf_tune.execution import Executor
from gtf_tune.pipelines import OptionValue, Pipeline, with_focal_prior
from gtf_tune.pipelines.run import RunOutcome, RunRequest
from gtf_tune.sequence import Sequence
from gtf_tune.study.ground_truth.record import side_metric
from gtf_tune.study.noise.ladder import NoiseProbe, fresh_runs
from gtf_tune.study.runs.plan import RunPlanner, SeedSource, run_order
from gtf_tune.study.runs.run_source import SequenceRuns, run_limits
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
    configuration: Configuration, sequence: Sequence, executor: Executor, on_run: Callable[[str], None] = lambda _: None
) -> Evaluation:
    """Return the score of a configuration; ``on_run`` gets a sentence for every run that ended.

    It is infeasible here only if fewer than four frames are registered: there is no nominal run to compare with.
    """
    gtf = configuration.gtf
    sequence = with_focal_prior(sequence, configuration.pipeline)
    planner = RunPlanner(configuration.pipeline, gtf, SeedSource(configuration.seed), {})
    limits = run_limits(configuration.limits)
    order = run_order(gtf.clean_runs, gtf.noisy_runs_max)
    sigma = gtf.noise_sigma
    if isinstance(sigma, str):
        probe = NoiseProbe(configuration.pipeline, configuration.options, gtf, configuration.seed, whole=False)
        sigma, reason = probe.choose(sequence, fresh_runs(executor, limits))
        on_run(f"noise of {sequence.name}: {sigma:g} grey levels ({reason})")
    requests = [planner.request(sequence, configuration.options, run, sigma=sigma, number=0) for run in order]

    def describe(request: RunRequest, outcome: RunOutcome) -> None:
        found = outcome.error or f"{len(outcome.trajectory)} frames, {outcome.wall_s:.1f} s"
        on_run(f"{request.kind} run {request.index}: {found}")

    runs = fresh_runs(executor, limits, describe)(requests)
    score = score_sequence(runs, least_floor(len(sequence)), gtf)
    return Evaluation(score, _true_error(sequence, runs, configuration.side_metric), configuration.side_metric)


def _true_error(sequence: Sequence, runs: SequenceRuns, definition: SideMetricDefinition) -> float:
    if sequence.ground_truth is None:
        return math.nan
    try:
        return side_metric(sequence.ground_truth, runs.clean, definition).value
    except TrajectoryError:
        return math.nan
