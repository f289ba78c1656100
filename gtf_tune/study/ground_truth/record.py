"""Record ground truth beside a final score; nothing that searches, scores or picks reads it."""

from collections import defaultdict
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from optuna.trial import Trial

from gtf_tune.definition import SideMetricDefinition
from gtf_tune.definition.loading import section_from_dict
from gtf_tune.errors import DefinitionError, TrajectoryError
from gtf_tune.metrics import AteSettings, MetricSettings, RpeRelation, RpeSettings, ate, rpe
from gtf_tune.store import ground_truth_errors, runs, studies
from gtf_tune.store.database import Database
from gtf_tune.store.ground_truth_errors import Validation
from gtf_tune.store.runs import TrialRun
from gtf_tune.store.studies import stored_definition
from gtf_tune.store.trial_queue import TrialLease
from gtf_tune.study.open_study import OpenStudy, folder_of, load_stored_sequence
from gtf_tune.study.runs.run_source import stored_by_sequence
from gtf_tune.study.scoring.trial_scorer import ScoredTrial
from gtf_tune.trajectory import Trajectory

_DEFAULT = SideMetricDefinition()


@dataclass(frozen=True)
class SideMetric:
    """The error against ground truth of a trial on one sequence.

    ``value`` is the mean over the clean runs, in the unit of the ground truth or in degrees; ``by_run`` holds each
    run's. Runs that could not be compared are left out and ``skipped`` says why.
    """

    value: float
    by_run: tuple[float, ...]
    skipped: tuple[str, ...] = ()


def side_metric(
    ground_truth: Trajectory, clean: Sequence[Trajectory], definition: SideMetricDefinition = _DEFAULT
) -> SideMetric:
    """Return the error of the clean runs of a trial against ground truth: ATE or RPE, after the alignment asked for.

    Raises
    ------
    TrajectoryError
        No run can be compared with the ground truth.
    """
    settings = metric_settings(definition)
    errors: list[float] = []
    skipped: list[str] = []
    for trajectory in clean:
        try:
            errors.append(_error(ground_truth, trajectory, settings))
        except TrajectoryError as error:
            skipped.append(str(error))
    if not errors:
        raise TrajectoryError(f"no run can be compared with the ground truth: {skipped[0] if skipped else 'no runs'}")
    return SideMetric(float(np.mean(errors)), tuple(errors), tuple(skipped))


def metric_settings(definition: SideMetricDefinition) -> MetricSettings:
    """Return the metric that a definition asks for."""
    if definition.metric == "ate":
        return AteSettings(definition.alignment)
    relation: RpeRelation = "rotation" if definition.metric == "rpe_rotation" else "translation"
    return RpeSettings(
        relation, definition.rpe_delta, definition.rpe_delta_unit, definition.rpe_pairs, definition.alignment
    )


def _error(ground_truth: Trajectory, trajectory: Trajectory, settings: MetricSettings) -> float:
    if isinstance(settings, AteSettings):
        return ate(ground_truth, trajectory, settings.alignment)
    return rpe(ground_truth, trajectory, settings)


def record_side_metric(study: OpenStudy, lease: TrialLease, trial: Trial, scored: ScoredTrial) -> None:
    """Store the error of the clean runs against ground truth, on every sequence that has it.

    It goes to a table of its own, and as the user attribute ``gt_ate`` (``gt_ate_NAME`` for several sequences;
    ``gt_rpe_translation``, ``gt_rpe_rotation`` where the definition asks for these) to Optuna.
    """
    definition = study.definition.side_metric
    found: list[Validation] = []
    for name, sequence in study.sequences.items():
        if sequence.ground_truth is None:
            continue
        measured = _validation(name, sequence.ground_truth, scored.by_sequence[name].clean, definition)
        found.append(measured)
        if measured.value is not None:
            key = definition.key if len(study.sequences) == 1 else f"{definition.key}_{name}"
            trial.set_user_attr(key, measured.value)
    if found:
        ground_truth_errors.save(study.database, lease.trial_id, found)


def changed_side_metric(definition: SideMetricDefinition, changes: Mapping[str, Any]) -> SideMetricDefinition:
    """Return a side metric with changes to its section, or raise `DefinitionError` for a wrong one."""
    return section_from_dict(SideMetricDefinition, {**definition.model_dump(), **changes}, source="side metric")


def recompute_side_metric(
    database: Database, name: str, definition: SideMetricDefinition, places: Mapping[str, Path] | None = None
) -> dict[int, list[Validation]]:
    """Return another side metric of the trials of a study by their numbers, from the stored trajectories.

    Nothing is run and nothing is stored; ground truth is read from the data sets, whose pixels must be the study's.
    ``places`` gives the folders of sequences that lie elsewhere here.

    Raises
    ------
    DefinitionError
        No sequence of the study has ground truth.
    SequenceError
        A data set is missing here or has changed.
    """
    study = studies.get(database, name)
    truths = _ground_truths(database, study, places or {})
    if not truths:
        raise DefinitionError(
            f"study '{name}' has no sequence with ground truth, so there is no side metric to compute"
        )
    clean: dict[int, list[TrialRun]] = defaultdict(list)
    for use in runs.of_study(database, study.id):
        if use.run.kind == "clean" and use.sequence_name in truths:
            clean[use.number].append(use)
    return {
        number: [
            _validation(name, truths[name], runs_.clean, definition)
            for name, runs_ in stored_by_sequence(database, used).items()
        ]
        for number, used in clean.items()
    }


def _ground_truths(database: Database, study: studies.Study, places: Mapping[str, Path]) -> dict[str, Trajectory]:
    known = {stored.name: stored for stored in studies.sequences(database, study.id)}
    found = {}
    for defined in stored_definition(study).searched_sequences:
        if not known[defined.name].has_ground_truth:
            continue
        root = Path(study.root)
        sequence, _ = load_stored_sequence(defined, known[defined.name], folder_of(defined, root, places))
        if sequence.ground_truth is not None:
            found[defined.name] = sequence.ground_truth
    return found


def _validation(
    name: str, ground_truth: Trajectory, clean: Sequence[Trajectory], definition: SideMetricDefinition
) -> Validation:
    about = {"metric": definition.metric, "unit": definition.unit, "definition": definition.model_dump(mode="json")}
    try:
        metric = side_metric(ground_truth, clean, definition)
    except TrajectoryError as error:
        return Validation(name, None, {**about, "message": str(error)})
    return Validation(name, metric.value, {**about, "by_run": list(metric.by_run), "skipped": list(metric.skipped)})
