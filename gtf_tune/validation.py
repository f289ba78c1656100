"""Measure runs against ground truth, as a yardstick beside the search.

This is called once a trial's score is final. Nothing that samples, prunes, scores or picks imports this module.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from gtf_tune.errors import TrajectoryError
from gtf_tune.metrics import ate
from gtf_tune.trajectory import Trajectory


@dataclass(frozen=True)
class SideMetric:
    """Hold the ground-truth ATE of a trial on one sequence.

    ``gt_ate`` is the mean over the clean runs of the Sim(3)-aligned ATE, in the unit of the ground truth; ``by_run``
    holds each run's. Runs that could not be aligned are left out and ``skipped`` says why.
    """

    gt_ate: float
    by_run: tuple[float, ...]
    skipped: tuple[str, ...] = ()


def side_metric(ground_truth: Trajectory, clean: Sequence[Trajectory]) -> SideMetric:
    """Return the ground-truth ATE of the clean runs of a trial.

    Raises
    ------
    TrajectoryError
        No run can be aligned with the ground truth.
    """
    errors: list[float] = []
    skipped: list[str] = []
    for trajectory in clean:
        try:
            errors.append(ate(ground_truth, trajectory, alignment="sim3"))
        except TrajectoryError as error:
            skipped.append(str(error))
    if not errors:
        raise TrajectoryError(f"no run can be compared with the ground truth: {skipped[0] if skipped else 'no runs'}")
    return SideMetric(float(np.mean(errors)), tuple(errors), tuple(skipped))
