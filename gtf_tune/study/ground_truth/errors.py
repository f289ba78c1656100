"""Measure runs against ground truth, as a yardstick beside the search.

This is called once a trial's score is final. Nothing that samples, prunes, scores or picks imports this module.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from gtf_tune.definition import SideMetricDefinition
from gtf_tune.errors import TrajectoryError
from gtf_tune.metrics import AteSettings, MetricSettings, RpeRelation, RpeSettings, ate, rpe
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
