"""Run the search loop of a study without database and processes, to repeat it many times.

Samplers, seeds, run planner, pipeline, score and feasibility are those of the package; only the bookkeeping is left
out. The tests of the study loop show that the bookkeeping changes no decision.
"""

import itertools
import math
import tempfile
import warnings
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import optuna

from gtf_tune.definition import StudyDefinition, definition_from_dict
from gtf_tune.execution import FreshStages
from gtf_tune.pipelines import OptionValue, PipelineJob
from gtf_tune.pipelines.analytic import AnalyticPipeline, create, imaginary_sequence
from gtf_tune.pipelines.run import RunKind
from gtf_tune.study.runs.plan import RunPlanner, SeedSource
from gtf_tune.study.runs.run_source import SequenceRuns
from gtf_tune.study.scoring.objective import CoverageFloor, SequenceScore, score_sequence
from gtf_tune.study.search.samplers import make_sampler
from gtf_tune.study.search.space import SearchSpace, build_space
from gtf_tune.trajectory import Trajectory

SEQUENCE = imaginary_sequence(50)
_SIGMA = 5.0

optuna.logging.set_verbosity(optuna.logging.WARNING)


@dataclass(frozen=True)
class Step:
    """How a search stood after one trial: runs spent so far, and the true error of its pick."""

    runs: int
    true_error: float


@dataclass
class BareStudy:
    """Search on the analytic pipeline; iterating over it makes one trial after another."""

    definition: StudyDefinition
    pipeline: AnalyticPipeline = field(default_factory=lambda: create({}))
    space: SearchSpace = field(init=False)
    runs: int = 0
    best: float = math.inf
    pick: Mapping[str, OptionValue] = field(default_factory=dict)
    floor: float = 0.0

    def __post_init__(self) -> None:
        self.space = build_space(self.definition, self.pipeline.options)
        self.planner = RunPlanner(
            self.pipeline,
            self.definition.gtf,
            SeedSource(self.definition.search.seed),
            self.definition.fixed_options,
        )
        self.study = optuna.create_study()

    def __iter__(self) -> Iterator[Step]:
        grid = self.space.grid() if self.definition.search.sampler == "grid" else itertools.repeat(None)
        points = itertools.chain([self.space.nominal], grid)
        for number, fixed in enumerate(points):
            with warnings.catch_warnings():
                warnings.simplefilter("ignore")
                self._trial(number, fixed)
            yield Step(self.runs, self.pipeline.expected_error({**self.definition.fixed_options, **self.pick}))

    def _trial(self, number: int, fixed: Mapping[str, Any] | None) -> None:
        self.study.sampler = make_sampler(self.definition.search, number, self.space)
        if fixed is not None:
            self.study.enqueue_trial(dict(fixed))
        trial = self.study.ask()
        options = self.space.suggest(trial)
        score = self._score(number, options)
        trial.set_constraint("coverage", score.violation)
        if score.score is None or not score.feasible:
            self.study.tell(trial, 2.0 - score.coverage)
            return
        instances = tuple(score.score.instance_values.tolist())
        for step, value in enumerate(instances):
            trial.report(value, step)
        value = score.score.value
        self.study.tell(trial, value)
        if value < self.best:
            self.best, self.pick = value, options

    def _score(self, number: int, options: Mapping[str, OptionValue]) -> SequenceScore:
        clean = [self._run(options, ("clean", index)) for index in range(self.definition.gtf.clean_runs)]
        coverage = min(map(len, clean)) / len(SEQUENCE)
        if number == 0:
            self.floor = self.definition.gtf.coverage_floor * coverage
        if coverage < self.floor:
            return SequenceScore(None, coverage, self.floor - coverage)
        noisy = [self._run(options, ("noisy", index)) for index in range(self.definition.gtf.noisy_runs_max)]
        runs = SequenceRuns(tuple(clean), tuple(noisy), len(SEQUENCE))
        return score_sequence(runs, CoverageFloor(self.floor, self.floor), self.definition.gtf)

    def _run(self, options: Mapping[str, OptionValue], run: tuple[RunKind, int]) -> Trajectory:
        self.runs += 1
        request = self.planner.request(SEQUENCE, options, run, sigma=_SIGMA, number=0)
        job = PipelineJob(
            images=request.images,
            options=request.options,
            seed=request.seed,
            threads=1,
            workspace=Path(tempfile.gettempdir()),
            stages=_NO_STAGES,
        )
        return self.pipeline.run(job).trajectory


with FreshStages().open(Path(tempfile.gettempdir())) as _stages:
    _NO_STAGES = _stages


def define(space: Mapping[str, Any], gtf: Mapping[str, Any], search: Mapping[str, Any]) -> StudyDefinition:
    """Return the definition of a study of the analytic pipeline with intrinsics held fixed."""
    return definition_from_dict(
        {
            "name": "bare",
            "pipeline": {"name": "analytic", "options": {"refine.intrinsics": False}},
            "sequences": [{"name": "imaginary", "path": "nowhere"}],
            "space": dict(space),
            "gtf": {"noise_sigma": _SIGMA, "aggregate": "median", **gtf},
            "search": dict(search),
        }
    )


def search(definition: StudyDefinition, budget: int, pipeline: AnalyticPipeline | None = None) -> list[Step]:
    """Return the steps of a search until it has spent ``budget`` runs or tried its whole grid."""
    steps: list[Step] = []
    for step in BareStudy(definition, pipeline or create({})):
        if step.runs > budget and steps:
            break
        steps.append(step)
    return steps
