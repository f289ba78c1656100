"""Score the trials of a study anew from their stored trajectories: another aggregate, metric, alignment or unit.

Nothing is run and nothing is stored: the study keeps the scores that its search went by.
"""

from collections import defaultdict
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from gtf_tune.alignment import MIN_MATCHED
from gtf_tune.definition import GtfDefinition
from gtf_tune.definition.loading import section_from_dict
from gtf_tune.errors import DefinitionError
from gtf_tune.store import runs, studies, trials
from gtf_tune.store.database import Database
from gtf_tune.store.runs import TrialRun
from gtf_tune.store.trajectories import trajectories
from gtf_tune.store.trials import Trial
from gtf_tune.study.objective import FinishedRun, SequenceScore, TrialScore, score_sequence, score_trial
from gtf_tune.study.stored import stored_definition

RESCORABLE = ("aggregate", "metric", "alignment", "normalise", "rpe_delta", "rpe_delta_unit", "rpe_pairs")


@dataclass(frozen=True)
class RescoredTrial:
    """Hold a trial with its new score beside the stored one, and its rank among feasible trials by each, from 1.

    Ranks are 0 where a trial is infeasible or was stopped early.
    """

    trial: Trial
    score: TrialScore
    rank_before: int = 0
    rank: int = 0


@dataclass(frozen=True)
class Rescored:
    """Hold a study scored anew, its trials by their ordinals."""

    gtf: GtfDefinition
    trials: tuple[RescoredTrial, ...]

    @property
    def best(self) -> RescoredTrial | None:
        """Return the trial that ranks first now, ``None`` where none is feasible."""
        return next((one for one in self.trials if one.rank == 1), None)


def rescore(database: Database, name: str, changes: Mapping[str, Any]) -> Rescored:
    """Return the trials of a study as they would score with changes to its ``[gtf]`` section.

    Raises
    ------
    DefinitionError
        A change needs other runs than the stored ones or is wrong, or no nominal trial is complete.
    """
    study = studies.get(database, name)
    definition = stored_definition(study)
    gtf = _changed(definition.gtf, changes)
    known = [one for one in trials.of_study(database, study.id) if one.state in ("complete", "pruned")]
    if not known or known[0].ordinal != 0:
        raise DefinitionError(f"study '{name}' has no complete nominal trial; run it with: gtf-tune study run {name}")
    uses: dict[int, list[TrialRun]] = defaultdict(list)
    for use in runs.of_study(database, study.id):
        uses[use.ordinal].append(use)
    nominal_coverage = _least_coverage(uses[0])
    scores: dict[int, TrialScore] = {}
    nominal_values: dict[str, float] = {}
    for trial in known:
        by_sequence = _score_sequences(database, uses[trial.ordinal], nominal_coverage if trial.ordinal else {}, gtf)
        scores[trial.ordinal] = score_trial(by_sequence, nominal_values or None, gtf)
        if trial.ordinal == 0:
            nominal_values = {key: one.score.value for key, one in by_sequence.items() if one.score and one.feasible}
    return Rescored(gtf, _ranked([RescoredTrial(trial, scores[trial.ordinal]) for trial in known]))


def _changed(gtf: GtfDefinition, changes: Mapping[str, Any]) -> GtfDefinition:
    refused = sorted(set(changes) - set(RESCORABLE))
    if refused:
        raise DefinitionError(
            f"{', '.join(refused)} cannot be changed without new runs; rescore takes {', '.join(RESCORABLE)}"
        )
    return section_from_dict(GtfDefinition, {**gtf.model_dump(), **changes}, source="rescore")


def _score_sequences(
    database: Database, uses: list[TrialRun], nominal_coverage: Mapping[str, float], gtf: GtfDefinition
) -> dict[str, SequenceScore]:
    """Return the score of each sequence; an empty ``nominal_coverage`` leaves the floor at four frames."""
    found = trajectories(database, [use.run.key for use in uses])
    scores = {}
    for name in dict.fromkeys(use.sequence_name for use in uses):
        mine = sorted((use for use in uses if use.sequence_name == name), key=lambda use: use.run.index)
        clean, noisy = (
            [FinishedRun(found[use.run.key], use.run.error) for use in mine if use.run.kind == kind]
            for kind in ("clean", "noisy")
        )
        num_frames = mine[0].run.num_frames
        floor = max(MIN_MATCHED / num_frames, gtf.coverage_floor * nominal_coverage.get(name, 0.0))
        scores[name] = score_sequence(clean, noisy, num_frames=num_frames, floor=floor, gtf=gtf)
    return scores


def _least_coverage(uses: list[TrialRun]) -> dict[str, float]:
    """Return the least coverage of nominal's runs by sequence, of its clean ones where a run failed."""
    failed = {use.sequence_name for use in uses if use.run.status == "failed"}
    coverage: dict[str, float] = {}
    for use in uses:
        if use.run.kind == "clean" or use.sequence_name not in failed:
            coverage[use.sequence_name] = min(use.run.coverage, coverage.get(use.sequence_name, 1.0))
    return coverage


def _ranked(rescored: list[RescoredTrial]) -> tuple[RescoredTrial, ...]:
    before = _ranks({one.trial.ordinal: one.trial.value for one in rescored if _counts(one.trial, one.trial.feasible)})
    now = _ranks({one.trial.ordinal: one.score.value for one in rescored if _counts(one.trial, one.score.feasible)})
    return tuple(
        RescoredTrial(one.trial, one.score, before.get(one.trial.ordinal, 0), now.get(one.trial.ordinal, 0))
        for one in rescored
    )


def _counts(trial: Trial, feasible: bool | None) -> bool:
    return trial.state == "complete" and bool(feasible)


def _ranks(values: Mapping[int, float | None]) -> dict[int, int]:
    order = sorted((value, ordinal) for ordinal, value in values.items() if value is not None)
    return {ordinal: rank for rank, (_, ordinal) in enumerate(order, start=1)}
