"""Score a trial: obtain its runs, and compare it with the nominal trial."""

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np

from gtf_tune.errors import DefinitionError
from gtf_tune.pipelines import OptionValue
from gtf_tune.pipelines.run import RunRequest
from gtf_tune.store import runs, trials
from gtf_tune.study.open_study import OpenStudy
from gtf_tune.study.runs.plan import FinishedRun, run_order
from gtf_tune.study.runs.run_source import RunSource, SequenceRuns, finished_by_sequence, stored_by_sequence
from gtf_tune.study.scoring.objective import (
    CoverageFloor,
    TrialScore,
    counted_frames,
    coverage_floor,
    least_floor,
    rules_of,
    score_sequence,
    score_trial,
)


@dataclass(frozen=True)
class Reference:
    """What the nominal trial found.

    ``nominal_scores`` and ``floors`` are by sequence; ``nominal_value`` is the value of trial 0, ``None`` while it is
    being scored or where it is infeasible. ``nominal_detail`` is what trial 0 stored, its matrices included.
    """

    floors: Mapping[str, CoverageFloor]
    nominal_scores: Mapping[str, float] = field(default_factory=dict)
    nominal_value: float | None = None
    nominal_detail: Mapping[str, Any] = field(default_factory=dict, repr=False)


@dataclass(frozen=True, eq=False)
class ScoredTrial:
    """Score of a trial with the runs that it was computed from.

    ``runs`` are in the order in which they count, ``by_sequence`` has their trajectories. ``instances`` are the values
    of the noisy instances in order: for several sequences the geometric mean over sequences, each relative to its
    nominal score. ``reference`` is what the trial is compared with.
    """

    options: Mapping[str, OptionValue]
    score: TrialScore
    reference: Reference = field(repr=False)
    runs: tuple[FinishedRun, ...] = field(repr=False)
    by_sequence: Mapping[str, SequenceRuns] = field(repr=False)
    instances: tuple[float, ...]

    @property
    def noisy_runs(self) -> int:
        """Number of noisy runs on each sequence."""
        return max(len(runs.noisy) for runs in self.by_sequence.values())


@dataclass
class TrialScorer:
    """Score one configuration on a growing number of noisy runs; runs that are there are not asked for again."""

    study: OpenStudy
    source: RunSource
    options: Mapping[str, OptionValue]
    number: int
    reference: Reference
    _finished: list[FinishedRun] = field(default_factory=list)

    def score(self, noisy_runs: int) -> ScoredTrial:
        """Return the score from all clean runs and the first ``noisy_runs`` noisy ones of each sequence.

        Raises
        ------
        Interrupted
            Someone asked to stop; runs that finished are stored.
        """
        gtf = self.study.definition.gtf
        requests = self._requests(noisy_runs)
        self._finished += self.source.obtain(requests[len(self._finished) :])
        finished = tuple(self._finished[: len(requests)])
        by_sequence = finished_by_sequence(finished)
        scores = {name: score_sequence(runs, self._floor(name, runs), gtf) for name, runs in by_sequence.items()}
        score = score_trial(scores, self.reference.nominal_scores or None, gtf)
        instances = instance_values(score, self.reference)
        return ScoredTrial(self.options, score, self.reference, finished, by_sequence, instances)

    def _floor(self, name: str, runs: SequenceRuns) -> CoverageFloor:
        """Return the floor of a sequence; nominal, which sets it, is scored by the frames that its own runs share."""
        floor = self.reference.floors[name]
        if self.number or rules_of(self.study.record) == 1:
            return floor
        return replace(floor, frames=counted_frames(runs))

    def _requests(self, noisy_runs: int) -> list[RunRequest]:
        """Return the requests in the order in which runs count: more noisy runs only add to the end."""
        study = self.study
        return [
            study.planner.request(sequence, self.options, run, sigma=study.sigmas[name], number=self.number)
            for run in run_order(study.definition.gtf.clean_runs, noisy_runs)
            for name, sequence in study.sequences.items()
        ]


def instance_values(score: TrialScore, reference: Reference) -> tuple[float, ...]:
    """Return the value of each noise instance of a feasible trial; empty for an infeasible one.

    Over several sequences it is the geometric mean of the scores relative to nominal's.
    """
    if not score.feasible:
        return ()
    tiny = np.finfo(np.float64).tiny
    rows = []
    for name, sequence in score.by_sequence.items():
        if sequence.score is None:
            return ()
        scale = reference.nominal_scores.get(name, sequence.score.value) if len(score.by_sequence) > 1 else 1.0
        rows.append(np.log(np.maximum(sequence.score.instance_values, tiny) / max(scale, tiny)))
    return tuple(float(value) for value in np.exp(np.mean(rows, axis=0)))


def read_reference(study: OpenStudy, number: int) -> Reference:
    """Return what the trial of this number is compared with.

    Raises
    ------
    DefinitionError
        Several sequences are tuned together and the nominal configuration has no score on one of them.
    """
    if number == 0:
        return Reference({name: least_floor(len(sequence)) for name, sequence in study.sequences.items()})
    nominal = trials.get(study.database, study.record.id, 0)
    stored = trials.details(study.database, [nominal.id])[nominal.id]
    detail = stored["sequences"]
    floors = _floors(study, nominal.id, detail)
    scores = {name: detail[name]["value"] for name in study.sequences if detail[name]["value"] is not None}
    if len(study.sequences) > 1 and len(scores) < len(study.sequences):
        reasons = [f"{name} ({detail[name]['message']})" for name in study.sequences if detail[name]["message"]]
        raise DefinitionError(
            f"the nominal setting has no score on {', '.join(reasons) or nominal.message}, so settings cannot be "
            "compared over several sequences; leave that sequence out or fix options so that the nominal setting works"
        )
    value = nominal.value if nominal.feasible else None
    return Reference(floors, scores, value, stored)


def _floors(study: OpenStudy, nominal_id: int, detail: Mapping[str, Any]) -> dict[str, CoverageFloor]:
    """Return the floors that nominal's runs set; their coverages are in its detail, except where it has no score."""
    share, rules = study.definition.gtf.coverage_floor, rules_of(study.record)
    unscored = any("coverage_noisy" not in detail[name] for name in study.sequences)
    uses = runs.of_trial(study.database, nominal_id) if unscored or rules > 1 else []
    frames = {name: counted_frames(one) for name, one in stored_by_sequence(study.database, uses).items()}
    floors = {}
    for name, sequence in study.sequences.items():
        clean, noisy = (
            detail[name].get(f"coverage_{kind}")
            or [use.run.coverage for use in uses if (use.sequence_name, use.run.kind) == (name, kind)]
            for kind in ("clean", "noisy")
        )
        floor = coverage_floor(clean, noisy, share, rules).at_least(least_floor(len(sequence)))
        floors[name] = replace(floor, frames=frames.get(name) if rules > 1 else None)
    return floors
