"""Obtain the runs of a trial and score them."""

from collections.abc import Mapping
from dataclasses import dataclass, field, replace

import numpy as np

from gtf_tune.pipelines import OptionValue
from gtf_tune.pipelines.run import RunKind
from gtf_tune.store.runs import RunUse
from gtf_tune.store.trajectories import trajectories
from gtf_tune.study.open_study import OpenStudy
from gtf_tune.study.runs.plan import run_order
from gtf_tune.study.runs.run_source import ObtainedRun, RunSlot, RunSource
from gtf_tune.study.scoring.early_stopping import Decision
from gtf_tune.study.scoring.objective import FinishedRun, TrialScore, score_sequence, score_trial
from gtf_tune.study.scoring.reference import Reference
from gtf_tune.trajectory import Trajectory


@dataclass(frozen=True)
class ScoredTrial:
    """Hold a trial's score with the runs it came from.

    ``instances`` are the values of the noisy instances in order: for several sequences the geometric mean over
    sequences, each relative to its nominal score. ``clean`` are the trajectories of the clean runs by sequence.
    """

    score: TrialScore
    uses: tuple[RunUse, ...]
    instances: tuple[float, ...]
    noisy_runs: int
    clean: Mapping[str, tuple[Trajectory, ...]] = field(repr=False)
    clean_coverage: Mapping[str, float]
    decision: Decision = field(default_factory=lambda: Decision(0))

    def decided(self, decision: Decision) -> "ScoredTrial":
        """Return the same with why the trial has as many noisy runs as it has."""
        return replace(self, decision=decision)


@dataclass
class TrialRuns:
    """Obtain runs of one setting, as many as asked for, and score them; runs it has are not asked for again."""

    study: OpenStudy
    source: RunSource
    options: Mapping[str, OptionValue]
    number: int
    _obtained: dict[RunSlot, ObtainedRun] = field(default_factory=dict)
    _finished: dict[RunSlot, FinishedRun] = field(default_factory=dict)

    def score(self, noisy: int, reference: Reference) -> ScoredTrial:
        """Return the score from all clean runs and the first ``noisy`` noisy ones."""
        clean_runs = self.study.definition.gtf.clean_runs
        obtained = self._obtain(run_order(clean_runs, noisy))
        finished = {slot: self._finished[slot] for slot in obtained}
        by_sequence = {name: _of_kind(finished, name) for name in self.study.sequences}
        gtf = self.study.definition.gtf
        scores = {
            name: score_sequence(
                clean,
                noisy_,
                num_frames=len(self.study.sequences[name]),
                floor=reference.floors[name],
                gtf=gtf,
            )
            for name, (clean, noisy_) in by_sequence.items()
        }
        score = score_trial(scores, reference.nominal_scores or None, gtf)
        return ScoredTrial(
            score=score,
            uses=tuple(RunUse(slot.sequence, one.run, one.reused) for slot, one in obtained.items()),
            instances=self._instances(score, reference),
            noisy_runs=noisy,
            clean={name: tuple(run.trajectory for run in clean) for name, (clean, _) in by_sequence.items()},
            clean_coverage={
                name: min(len(run.trajectory) for run in clean) / len(self.study.sequences[name])
                for name, (clean, _) in by_sequence.items()
            },
        )

    def _obtain(self, order: list[tuple[RunKind, int]]) -> dict[RunSlot, ObtainedRun]:
        planner, sequences = self.study.planner, self.study.sequences
        slots = [RunSlot(name, kind, index) for kind, index in order for name in sequences]
        missing = {
            slot: planner.request(
                sequences[slot.sequence],
                self.options,
                (slot.kind, slot.index),
                sigma=self.study.sigmas[slot.sequence],
                number=self.number,
            )
            for slot in slots
            if slot not in self._obtained
        }
        obtained = self.source.obtain(missing)
        found = trajectories(self.source.database, [one.run.key for one in obtained.values()])
        self._obtained.update(obtained)
        self._finished.update((slot, FinishedRun(found[one.run.key], one.run.error)) for slot, one in obtained.items())
        return {slot: self._obtained[slot] for slot in slots}

    def _instances(self, score: TrialScore, reference: Reference) -> tuple[float, ...]:
        if not score.feasible:
            return ()
        rows = []
        for name, one in score.by_sequence.items():
            if one.score is None:
                return ()
            scale = reference.nominal_scores.get(name, one.score.value) if len(score.by_sequence) > 1 else 1.0
            tiny = np.finfo(np.float64).tiny
            rows.append(np.log(np.maximum(one.score.instance_values, tiny) / max(scale, tiny)))
        return tuple(float(value) for value in np.exp(np.mean(rows, axis=0)))


def _of_kind(
    finished: Mapping[RunSlot, FinishedRun], sequence: str
) -> tuple[tuple[FinishedRun, ...], tuple[FinishedRun, ...]]:
    mine = {slot: run for slot, run in finished.items() if slot.sequence == sequence}
    clean = tuple(run for slot, run in mine.items() if slot.kind == "clean")
    noisy = tuple(run for slot, run in mine.items() if slot.kind == "noisy")
    return clean, noisy
