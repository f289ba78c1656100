"""Read what an experiment measured: each setting with its matrix, its true error, and other predictors of it."""

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from types import MappingProxyType

import numpy as np

from experiments.estimators import between, dispersion, paired_ratio
from experiments.numbers import spearman
from experiments.plan import Experiment
from gtf_tune.errors import TrajectoryError
from gtf_tune.gtf import Aggregate, aggregate_matrix
from gtf_tune.metrics import ate
from gtf_tune.store import confirmations, ground_truth_errors, runs, studies, trials
from gtf_tune.store.database import Database
from gtf_tune.store.runs import trajectories
from gtf_tune.study.outcome.verdict import verdict_of
from gtf_tune.trajectory import FloatArray, Trajectory

AGGREGATES: tuple[Aggregate, ...] = ("mean", "median", "gmean", "trimmed")


@dataclass(frozen=True, eq=False)
class Setting:
    """One value of an option.

    ``matrix`` (k, k_delta) is NaN where the setting is infeasible. ``true_ate`` is the true error of the clean runs in
    the unit of the ground truth, ``noisy_true_ates`` (k_delta,) those of the noisy runs, NaN where a run failed or the
    setting is infeasible, empty where ground truth is not at hand.
    ``clean_clean``, ``noisy_noisy``, ``dispersion`` and ``paired`` are the other estimators of precision.
    """

    number: int
    value: float
    feasible: bool
    coverage: float
    true_ate: float
    noisy_true_ates: FloatArray
    matrix: FloatArray
    collapsed: float
    clean_clean: float
    noisy_noisy: float
    dispersion: float
    paired: float
    reprojection_px: float


Predictor = Callable[[Setting], float]


def _aggregated(aggregate: Aggregate, setting: Setting) -> float:
    return aggregate_matrix(setting.matrix, aggregate)


PREDICTORS: Mapping[str, Predictor] = MappingProxyType(
    {
        **{name: partial(_aggregated, name) for name in AGGREGATES},
        "paired": lambda one: one.paired,
        "noisy-noisy": lambda one: one.noisy_noisy,
        "dispersion": lambda one: one.dispersion,
        "clean-clean": lambda one: one.clean_clean,
        "reprojection": lambda one: one.reprojection_px,
    }
)
"""What might foretell the true error: aggregates of the matrix, other estimators from the same runs, reprojection."""


@dataclass(frozen=True)
class Agreement:
    """Say how well a predictor ranks settings: linear correlation, rank correlation, and the setting that it picks."""

    correlation: float
    spearman: float
    pick: Setting

    @property
    def r_squared(self) -> float:
        """Return the share of the variance of the true error that a line through the predictor explains."""
        return self.correlation**2


@dataclass(frozen=True, eq=False)
class Outcome:
    """One finished experiment; ``adopted`` is nominal where the confirmation kept it, None before there is one."""

    experiment: Experiment
    settings: tuple[Setting, ...]
    adopted: Setting | None
    verdict: str

    @property
    def nominal(self) -> Setting:
        return self.settings[0]

    @property
    def feasible(self) -> list[Setting]:
        return [setting for setting in self.settings if setting.feasible and math.isfinite(setting.true_ate)]

    @property
    def works(self) -> bool:
        """Whether nominal is feasible and its true error is known: all others are judged against it."""
        return self.nominal in self.feasible

    @property
    def oracle(self) -> Setting:
        return min(self.feasible, key=lambda one: one.true_ate)

    def change(self, setting: Setting) -> float:
        """Return the true error of a setting relative to nominal's, negative where it is better."""
        return setting.true_ate / self.nominal.true_ate - 1

    def knows(self, predictor: Predictor) -> bool:
        """Return True if a predictor was measured for every feasible setting."""
        return all(math.isfinite(predictor(one)) for one in self.feasible)

    def agreement(self, predictor: Predictor) -> Agreement:
        """Return how well a predictor foretells the true error."""
        predicted = [predictor(one) for one in self.feasible]
        true = [one.true_ate for one in self.feasible]
        pick = min(zip(predicted, range(len(true)), strict=True))[1]
        if len(set(predicted)) < 2 or len(set(true)) < 2:
            return Agreement(math.nan, math.nan, self.feasible[pick])
        correlation = float(np.corrcoef(predicted, true)[0, 1])
        return Agreement(correlation, spearman(predicted, true), self.feasible[pick])


def read_outcome(database: Database, experiment: Experiment, truth: Trajectory | None) -> Outcome | None:
    """Return a finished experiment, or None where some of its trials are missing.

    ``truth`` is the ground truth of the sequence, None where it is not at hand.
    """
    if experiment.study not in studies.names(database):
        return None
    study = studies.get(database, experiment.study)
    if study.state != "done":
        return None
    known = trials.of_study(database, study.id)
    nominal = _matrix(database, experiment, known[0])
    settings = tuple(_setting(database, experiment, trial, nominal, truth) for trial in known)
    stored = confirmations.of_study(database, study.id)
    if not stored:
        return Outcome(experiment, settings, None, "unconfirmed")
    adopted = verdict_of(stored[-1]).adopted or 0
    return Outcome(
        experiment, settings, next(setting for setting in settings if setting.number == adopted), stored[-1].verdict
    )


def _setting(
    database: Database, experiment: Experiment, trial: trials.Trial, nominal: FloatArray, truth: Trajectory | None
) -> Setting:
    matrix = _matrix(database, experiment, trial)
    used = [use.run for use in runs.of_trial(database, trial.id)]
    clean, noisy = ([run for run in used if run.kind == kind] for kind in ("clean", "noisy"))
    found = trajectories(database, [run.key for run in used])
    clean_poses, noisy_poses = ([found[run.key] for run in group] for group in (clean, noisy))
    errors = [float(run.diagnostics.get("mean_reprojection_error_px", math.nan)) for run in clean]
    validated = ground_truth_errors.of_study(database, trial.study_id).get(trial.number, [])
    return Setting(
        number=trial.number,
        value=float((trial.options or {})[experiment.option.name]),
        feasible=bool(trial.feasible),
        coverage=trial.coverage or 0.0,
        true_ate=next((one.ate for one in validated if one.ate is not None), math.nan),
        noisy_true_ates=true_ates(truth, noisy_poses),
        matrix=matrix,
        collapsed=trial.collapsed_rate or 0.0,
        clean_clean=between(clean_poses),
        noisy_noisy=between(noisy_poses),
        dispersion=dispersion([*clean_poses, *noisy_poses]),
        paired=paired_ratio(nominal, matrix),
        reprojection_px=float(np.mean(errors)),
    )


def true_ates(truth: Trajectory | None, found: Sequence[Trajectory]) -> FloatArray:
    """Return the true ATEs of trajectories; NaN where one cannot be compared, empty without ground truth."""
    return np.array([] if truth is None else [_true_ate(truth, one) for one in found], dtype=np.float64)


def _true_ate(truth: Trajectory, found: Trajectory) -> float:
    try:
        return ate(truth, found, alignment="sim3")
    except TrajectoryError:
        return math.nan


def _matrix(database: Database, experiment: Experiment, trial: trials.Trial) -> FloatArray:
    detail = trials.details(database, [trial.id])[trial.id]["sequences"][experiment.sequence]
    return np.array(detail.get("matrix", [[math.nan]]), dtype=np.float64)
