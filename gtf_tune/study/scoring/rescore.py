"""Score the trials of a study anew from their stored trajectories: another aggregate, metric, alignment or unit.

Nothing is run and nothing is stored: the study keeps the scores that its search went by.
"""

from collections import defaultdict
from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Any

from gtf_tune.definition import GtfDefinition
from gtf_tune.definition.loading import section_from_dict
from gtf_tune.errors import DefinitionError
from gtf_tune.store import runs, studies, trials
from gtf_tune.store.database import Database
from gtf_tune.store.runs import TrialRun
from gtf_tune.store.studies import stored_definition
from gtf_tune.store.trials import Trial
from gtf_tune.study.runs.run_source import SequenceRuns, stored_by_sequence
from gtf_tune.study.scoring.objective import (
    CoverageFloor,
    SequenceScore,
    TrialScore,
    check_rules,
    counted_frames,
    coverage_floor,
    least_floor,
    rules_of,
    score_sequence,
    score_trial,
)

RESCORABLE = ("aggregate", "metric", "alignment", "normalise", "rpe_delta", "rpe_delta_unit", "rpe_pairs")


@dataclass(frozen=True)
class RescoredTrial:
    """Trial with its new score beside the stored one, and its rank among feasible trials by each, from 1.

    Ranks are 0 where a trial is infeasible or was stopped early.
    """

    trial: Trial
    score: TrialScore
    rank_before: int = 0
    rank: int = 0


@dataclass(frozen=True)
class Rescored:
    """Trials of a study, scored anew, by their numbers."""

    gtf: GtfDefinition
    trials: tuple[RescoredTrial, ...]

    @property
    def best(self) -> RescoredTrial | None:
        """Return the trial that ranks first now, ``None`` where none is feasible."""
        return next((trial for trial in self.trials if trial.rank == 1), None)


def rescore(database: Database, name: str, changes: Mapping[str, Any]) -> Rescored:
    """Return the trials of a study as they would score with changes to its ``[gtf]`` section.

    Raises
    ------
    DefinitionError
        A change needs other runs than the stored ones or is wrong, no nominal trial is complete, or the study is
        scored by other rules than those of this version.
    """
    study = studies.get(database, name)
    check_rules(study)
    definition, rules = stored_definition(study), rules_of(study)
    gtf = _changed(definition.gtf, changes)
    known = [one for one in trials.of_study(database, study.id) if one.state in ("complete", "pruned")]
    if not known or known[0].number != 0:
        raise DefinitionError(f"study '{name}' has no complete nominal trial; run it first", remedy=("run", name))
    uses: dict[int, list[TrialRun]] = defaultdict(list)
    for use in runs.of_study(database, study.id):
        uses[use.number].append(use)
    floors: dict[str, CoverageFloor] = {}
    scores: dict[int, TrialScore] = {}
    nominal_values: dict[str, float] = {}
    for trial in known:
        sequences = stored_by_sequence(database, uses[trial.number])
        if not floors:
            floors = {key: _own_floor(runs_, rules) for key, runs_ in sequences.items()}
        by_sequence = {name: score_sequence(runs_, floors[name], gtf) for name, runs_ in sequences.items()}
        scores[trial.number] = score_trial(by_sequence, nominal_values or None, gtf)
        if trial.number == 0:
            nominal_values = {key: one.score.value for key, one in by_sequence.items() if one.score and one.feasible}
            floors = {key: _floor(runs_, gtf, rules) for key, runs_ in sequences.items()}
            _check_nominal(by_sequence, name)
    return Rescored(gtf, _ranked([RescoredTrial(trial, scores[trial.number]) for trial in known]))


def _changed(gtf: GtfDefinition, changes: Mapping[str, Any]) -> GtfDefinition:
    refused = sorted(set(changes) - set(RESCORABLE))
    if refused:
        raise DefinitionError(
            f"{', '.join(refused)} cannot be changed without new runs; rescore takes {', '.join(RESCORABLE)}"
        )
    return section_from_dict(GtfDefinition, {**gtf.model_dump(), **changes}, source="rescore")


def _own_floor(nominal: SequenceRuns, rules: int) -> CoverageFloor:
    """Return the floor of nominal itself: the frames that an alignment needs are enough."""
    return replace(least_floor(nominal.num_frames), frames=counted_frames(nominal) if rules > 1 else None)


def _check_nominal(by_sequence: Mapping[str, SequenceScore], name: str) -> None:
    without = [sequence for sequence, one in by_sequence.items() if not one.feasible]
    if len(by_sequence) > 1 and without:
        raise DefinitionError(
            f"study '{name}' cannot be rescored so: its nominal setting has no such score on {', '.join(without)} "
            f"({by_sequence[without[0]].message}), with which the others are compared; choose another metric or unit"
        )


def _floor(nominal: SequenceRuns, gtf: GtfDefinition, rules: int) -> CoverageFloor:
    """Return the coverage floor that nominal's runs on a sequence set."""
    floor = coverage_floor(nominal.clean_coverage, nominal.noisy_coverage, gtf.coverage_floor, rules)
    own = _own_floor(nominal, rules)
    return replace(floor.at_least(own), frames=own.frames)


def _ranked(rescored: list[RescoredTrial]) -> tuple[RescoredTrial, ...]:
    before = _ranks({one.trial.number: one.trial.value for one in rescored if _counts(one.trial, one.trial.feasible)})
    now = _ranks({one.trial.number: one.score.value for one in rescored if _counts(one.trial, one.score.feasible)})
    return tuple(
        RescoredTrial(one.trial, one.score, before.get(one.trial.number, 0), now.get(one.trial.number, 0))
        for one in rescored
    )


def _counts(trial: Trial, feasible: bool | None) -> bool:
    return trial.state == "complete" and bool(feasible)


def _ranks(values: Mapping[int, float | None]) -> dict[int, int]:
    order = sorted((value, number) for number, value in values.items() if value is not None)
    return {number: rank for rank, (_, number) in enumerate(order, start=1)}
