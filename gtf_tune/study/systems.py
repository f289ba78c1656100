"""Compare systems on one sequence without a study: pipelines, programs or options, under the same noise."""

import math
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass
from itertools import combinations
from pathlib import Path
from statistics import median
from typing import Any

from gtf_tune.definition import GtfDefinition, SideMetricDefinition, read_options, read_toml
from gtf_tune.errors import DefinitionError, TrajectoryError
from gtf_tune.gtf import GtfScore
from gtf_tune.pipelines import OptionValue, Pipeline, create_pipeline, with_focal_prior
from gtf_tune.pipelines.command.places import rooted
from gtf_tune.sequence import Sequence as ImageSequence
from gtf_tune.study.ground_truth.record import side_metric
from gtf_tune.study.noise.choice import choose_noise, stored_runs
from gtf_tune.study.outcome.confirm import measured
from gtf_tune.study.outcome.contradiction import LEAST_FRAMES
from gtf_tune.study.outcome.judge import NOT_BETTER, TOO_LITTLE, Findings, Measured, judge
from gtf_tune.study.outcome.verdict import Candidate, Verdict
from gtf_tune.study.runs.plan import FinishedRun, RunPlanner, SeedSource, run_order
from gtf_tune.study.runs.run_source import RunSource, finished_by_sequence

PURPOSE = "compare"
"""What seeds are derived from: the noise is none that a search has seen."""

_RESULTS = (NOT_BETTER, TOO_LITTLE, "worse on ")
_SAME_SCALE = 1.2
"""Factor between the extents of two trajectories from which on unscaled errors have other units."""


@dataclass(frozen=True)
class System:
    """A pipeline with its options, under a name."""

    name: str
    pipeline: Pipeline
    options: Mapping[str, OptionValue]


@dataclass(frozen=True, eq=False)
class MeasuredSystem:
    """What the runs of one system gave.

    ``run_s`` is the median time of a run that was made, in seconds, with stages that others left in the cache taken as
    they are; ``true_error`` that of the clean runs against ground truth. Both are NaN where they are unknown.
    """

    name: str
    scores: Measured
    run_s: float
    true_error: float

    @property
    def score(self) -> GtfScore:
        """Score on the only sequence."""
        return next(iter(self.scores.scores.values()))

    @property
    def coverage(self) -> float:
        """Registered frames of the worst run over the frames of the sequence."""
        return float(min(self.score.coverage_clean.min(), self.score.coverage_noisy.min()))


@dataclass(frozen=True)
class OrderAgreement:
    """How often the score orders two systems as ground truth does.

    ``pairs`` counts the pairs of systems that have both, ``agreeing`` those in the same order, ``tau`` is Kendall's.
    """

    pairs: int
    agreeing: int

    @property
    def tau(self) -> float:
        """Kendall's rank correlation; NaN without a pair."""
        return 2 * self.agreeing / self.pairs - 1 if self.pairs else math.nan


@dataclass(frozen=True, eq=False)
class SystemComparison:
    """Systems under the same noise; each but the first is compared with the first.

    ``verdict`` is that of a confirmation where the first system is nominal; ``sigma`` is in grey levels.
    """

    systems: tuple[MeasuredSystem, ...]
    verdict: Verdict
    sigma: float

    def candidate(self, index: int) -> Candidate:
        """Return how the system of that index, from 1, compares with the first."""
        return self.verdict.candidates[index - 1]

    def is_comparable(self, index: int) -> bool:
        """Whether the system of that index, from 1, covers the same frames as the first, in the same scale."""
        first, other = self.systems[0], self.systems[index]
        scales = [one.score.extent for one in (first, other)]
        return (
            self.candidate(index).improvement.is_known
            and other.coverage >= LEAST_FRAMES * first.coverage
            and (first.score.settings.is_relative or max(scales) <= _SAME_SCALE * min(scales))
        )

    def remarks(self, index: int) -> tuple[str, ...]:
        """Return what a confirmation would hold against the system of that index, but for its score."""
        doubts = self.verdict.doubts or ()
        found = [one for one in self.candidate(index).reasons if one not in doubts and not one.startswith(_RESULTS)]
        return tuple(self.named(reason) for reason in found)

    def named(self, sentence: str) -> str:
        """Return a sentence about nominal with the name of the first system."""
        name = Path(self.systems[0].name).name
        return sentence.replace("the nominal options", name).replace("nominal", name)

    @property
    def agreement(self) -> OrderAgreement:
        """How often scores and ground truth order two comparable systems alike."""
        comparable = [one for index, one in enumerate(self.systems) if not index or self.is_comparable(index)]
        known = [(one.score.value, one.true_error) for one in comparable]
        return order_agreement([both for both in known if not any(map(math.isnan, both))])

    def as_json(self) -> dict[str, Any]:
        """Return the numbers by name."""
        rows = [
            {
                "name": system.name,
                "options": dict(system.scores.options),
                "gtf_ate": system.score.value,
                "confidence_interval": list(system.score.confidence_interval),
                "coverage": system.coverage,
                "run_s": system.run_s,
                "true_error": system.true_error,
                "against_first": self.candidate(index).as_json() if index else None,
                "comparable": not index or self.is_comparable(index),
            }
            for index, system in enumerate(self.systems)
        ]
        agreement = {**asdict(self.agreement), "tau": self.agreement.tau}
        return {"noise_sigma": self.sigma, "systems": rows, "doubts": self.verdict.doubts, "agreement": agreement}


def order_agreement(known: Sequence[tuple[float, float]]) -> OrderAgreement:
    """Return how often two quantities order a pair alike; pairs that are equal in one of them do not count."""
    products = [(a[0] - b[0]) * (a[1] - b[1]) for a, b in combinations(known, 2)]
    return OrderAgreement(sum(one != 0 for one in products), sum(one > 0 for one in products))


def read_system(text: str, pipeline: str = "glomap", settings: Mapping[str, Any] | None = None) -> System:
    """Return the system that a word names: a pipeline, a TOML definition of a program or study, a JSON file of options.

    Parameters
    ----------
    text
        The word or path, which is also its name.
    pipeline, settings
        The pipeline that options in a JSON file are for; the settings count for pipelines that are named too.

    Raises
    ------
    GtfTuneError
        There is no such pipeline or file, or an option is unknown.
    """
    if text.endswith(".json"):
        made, own = create_pipeline(pipeline, settings or {}), read_options(Path(text))
    else:
        made, own = named_pipeline(text, settings or {})
    return System(text, made, made.options.check(own))


def named_pipeline(text: str, settings: Mapping[str, Any]) -> tuple[Pipeline, dict[str, Any]]:
    """Return a registered pipeline, or that of a definition of a program or study, with the options that it states."""
    if not text.endswith(".toml"):
        return create_pipeline(text, settings), {}
    path = Path(text)
    section = read_toml(path, "a definition of a program or of a study").get("pipeline")
    if isinstance(section, dict):
        own = {**section.get("nominal", {}), **section.get("options", {})}
        name, given = str(section.get("name", "")), {**section.get("settings", {}), **settings}
        return create_pipeline(name, rooted(given, path.parent) if name == "command" else given), own
    return create_pipeline("command", {"definition": text, **settings}), {}


def compare_systems(
    systems: Sequence[System], sequence: ImageSequence, gtf: GtfDefinition, seed: int, source: RunSource
) -> SystemComparison:
    """Run all systems on clean images and on the same noisy ones, and compare each with the first.

    Where the definition leaves the noise open it is measured with the first system.

    Raises
    ------
    DefinitionError
        There are fewer than two systems, or a name comes twice.
    Interrupted
        Someone asked to stop; finished runs are stored.
    """
    names = [system.name for system in systems]
    if len(set(names)) < max(2, len(names)):
        raise DefinitionError(f"two or more different systems can be compared, not {', '.join(names) or 'none'}")
    sigma = chosen_noise(systems[0], sequence, gtf, seed, source)
    found = [
        measure_system(system, number, sequence, Bench(gtf, sigma, seed, source))
        for number, system in enumerate(systems)
    ]
    first, *others = [system.scores for system in found]
    return SystemComparison(tuple(found), judge(Findings(first, tuple(others)), gtf), sigma)


def chosen_noise(system: System, sequence: ImageSequence, gtf: GtfDefinition, seed: int, source: RunSource) -> float:
    """Return the noise in grey levels: what the definition says, else what suits the sequence under a system."""
    if not isinstance(gtf.noise_sigma, str):
        return gtf.noise_sigma
    planner = RunPlanner(system.pipeline, _common(gtf), SeedSource(seed, PURPOSE), {})
    sequence = with_focal_prior(sequence, system.pipeline)
    return choose_noise(sequence, stored_runs(source), planner, system.options)[0]


def _common(gtf: GtfDefinition) -> GtfDefinition:
    """Return the score with the same noise for all systems, whatever a search did."""
    return gtf.model_copy(update={"common_noise": True})


@dataclass(frozen=True)
class Bench:
    """How systems are measured: the score, the noise in grey levels, the seed, and where runs come from."""

    gtf: GtfDefinition
    sigma: float
    seed: int
    source: RunSource


def measure_system(
    system: System, number: int, sequence: ImageSequence, bench: Bench, noisy_runs: int | None = None
) -> MeasuredSystem:
    """Return what a system gives on the clean images and on ``noisy_runs`` noisy copies (default: the definition's)."""
    sequence = with_focal_prior(sequence, system.pipeline)
    gtf = _common(bench.gtf)
    planner = RunPlanner(system.pipeline, gtf, SeedSource(bench.seed, PURPOSE), {})
    order = run_order(gtf.clean_runs, noisy_runs or gtf.noisy_runs_max)
    runs = bench.source.obtain(
        [planner.request(sequence, system.options, run, sigma=bench.sigma, number=0) for run in order]
    )
    return MeasuredSystem(
        name=system.name,
        scores=measured(number, system.options, runs, gtf),
        run_s=median([run.stored.wall_s for run in runs]),
        true_error=_true_error(sequence, runs),
    )


def _true_error(sequence: ImageSequence, runs: list[FinishedRun]) -> float:
    if sequence.ground_truth is None:
        return math.nan
    try:
        clean = finished_by_sequence(runs)[sequence.name].clean
        return side_metric(sequence.ground_truth, clean, SideMetricDefinition()).value
    except TrajectoryError:
        return math.nan
