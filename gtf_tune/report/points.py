"""What is drawn of trials: scores, options, errors, and the details of one on one sequence."""

import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from statistics import fmean
from typing import Any, Literal

import numpy as np

from gtf_tune.display import ScoreUnit, definition_unit, sequence_unit
from gtf_tune.pipelines import OptionValue
from gtf_tune.report.study_data import StudyData
from gtf_tune.store.trials import Trial
from gtf_tune.study.scoring.objective import CoverageFloor, coverage_floor, rules_of
from gtf_tune.trajectory import FloatArray


@dataclass(frozen=True, eq=False)
class SequenceDetail:
    """Score of one trial on one sequence with its matrix; NaN where there is no number.

    ``matrix`` is (k, k_delta), as stored, NaN where a pair failed; ``pair_errors`` says why by indices. Coverages are
    fractions of the frames, ``extent`` is in the unit of the trajectory.
    """

    value: float
    low: float
    high: float
    matrix: FloatArray
    pair_errors: Mapping[tuple[int, int], str]
    coverage: float
    coverage_clean: tuple[float, ...]
    coverage_noisy: tuple[float, ...]
    collapsed: tuple[bool, ...]
    extent: float
    message: str


def sequence_detail(data: StudyData, number: int, sequence: str) -> SequenceDetail:
    """Return what is stored for one trial and sequence; everything is NaN or empty where nothing is."""
    stored = data.details.get(number, {}).get("sequences", {}).get(sequence, {})
    low, high = stored.get("ci") or (None, None)
    return SequenceDetail(
        value=stored_number(stored.get("value")),
        low=stored_number(low),
        high=stored_number(high),
        matrix=_matrix(stored.get("matrix") or []),
        pair_errors={_pair(key): reason for key, reason in (stored.get("pair_errors") or {}).items()},
        coverage=stored_number(stored.get("coverage")),
        coverage_clean=tuple(stored.get("coverage_clean") or ()),
        coverage_noisy=tuple(stored.get("coverage_noisy") or ()),
        collapsed=tuple(stored.get("collapsed") or ()),
        extent=stored_number(stored.get("extent")),
        message=str(stored.get("message") or ""),
    )


def nominal_floor(data: StudyData, sequence: str) -> CoverageFloor | None:
    """Return the coverage floor, which follows from the runs of trial 0; None before that trial is complete."""
    stored = data.details.get(0, {}).get("sequences", {}).get(sequence, {})
    clean = stored.get("coverage_clean") or [stored_number(stored.get("coverage_nominal"))]
    if math.isnan(clean[0]):
        return None
    share, rules = data.definition.gtf.coverage_floor, rules_of(data.study)
    return coverage_floor(clean, stored.get("coverage_noisy") or [], share, rules)


def stored_number(value: Any) -> float:
    """Return a number as it is stored, NaN where that is None."""
    return math.nan if value is None else float(value)


def _matrix(rows: Sequence[Sequence[float | None]]) -> FloatArray:
    matrix = np.array([[stored_number(value) for value in row] for row in rows], dtype=np.float64)
    return matrix if matrix.ndim == 2 else matrix.reshape(0, 0)


def _pair(key: str) -> tuple[int, int]:
    first, _, second = key.partition(",")
    return int(first), int(second)


PointState = Literal["feasible", "infeasible", "pruned", "failed", "running", "interrupted", "waiting"]
_REPROJECTION = "mean_reprojection_error_px"


@dataclass(frozen=True)
class TrialPoint:
    """One trial for drawing; numbers are NaN where they are not known.

    ``value``, ``low`` and ``high`` (95 % interval) are in the unit of the points, ``ground_truth`` in that of the
    ground truth, or relative to nominal where sequences are combined. ``coverage`` is that of the worst run.
    """

    number: int
    state: PointState
    options: Mapping[str, OptionValue] = field(default_factory=dict)
    value: float = math.nan
    low: float = math.nan
    high: float = math.nan
    ground_truth: float = math.nan
    reprojection_px: float = math.nan
    coverage: float = math.nan
    collapsed: float = math.nan
    noisy_runs: int = 0
    wall_s: float = math.nan
    message: str = ""

    @property
    def has_ended(self) -> bool:
        """Whether the trial has ended in any way."""
        return self.state not in ("running", "interrupted", "waiting")

    @property
    def is_scored(self) -> bool:
        """Whether the trial is feasible and has a value."""
        return self.state == "feasible" and math.isfinite(self.value)


@dataclass(frozen=True)
class PointSet:
    """The trials of a study as points, over all its sequences or for one, with the unit of their values.

    ``truth_label`` names the unit of ``ground_truth``.
    """

    title: str
    unit: ScoreUnit
    truth_label: str
    points: tuple[TrialPoint, ...]

    @property
    def truth_name(self) -> str:
        """Return what ``ground_truth`` is, without its unit."""
        return self.truth_label.rsplit(" [", 1)[0]

    @cached_property
    def scored(self) -> tuple[TrialPoint, ...]:
        """Return the feasible points."""
        return tuple(point for point in self.points if point.is_scored)

    @property
    def nominal(self) -> TrialPoint | None:
        """Return the point of trial 0, if it is feasible."""
        return next((point for point in self.scored if point.number == 0), None)

    @property
    def has_ground_truth(self) -> bool:
        """Whether any feasible point has ground truth."""
        return any(math.isfinite(point.ground_truth) for point in self.scored)


def study_points(data: StudyData) -> PointSet:
    """Return the trials with the values that the search minimises."""
    if not data.has_several_sequences:
        return sequence_points(data, data.sequences[0].name)
    unit = definition_unit(data.definition)
    truth, reprojection = _combined_truth(data), _reprojection(data, {sequence.name for sequence in data.sequences})
    points = [
        _point(trial, trial.gtf_ate, unit, (trial.ci_low, trial.ci_high), truth, reprojection) for trial in data.trials
    ]
    return PointSet(
        "all sequences", unit, f"ground-truth {data.definition.side_metric.words} [relative to nominal]", tuple(points)
    )


def sequence_points(data: StudyData, sequence: str) -> PointSet:
    """Return the trials with the scores that they have on one sequence."""
    unit, side = sequence_unit(data.definition.gtf), data.definition.side_metric
    truth, reprojection = _truth(data, sequence), _reprojection(data, {sequence})
    points = []
    for trial in data.trials:
        detail = sequence_detail(data, trial.number, sequence)
        points.append(_point(trial, detail.value, unit, (detail.low, detail.high), truth, reprojection))
    return PointSet(sequence, unit, f"ground-truth {side.words} [{side.unit}]", tuple(points))


def point_sets(data: StudyData) -> list[PointSet]:
    """Return the points of the study and, where it has several sequences, those of each of them."""
    if not data.has_several_sequences:
        return [study_points(data)]
    return [study_points(data), *(sequence_points(data, sequence.name) for sequence in data.sequences)]


def state_of(trial: Trial) -> PointState:
    """Return how a trial ended, in one word."""
    if trial.unfinished:
        return trial.unfinished
    if trial.state == "complete":
        return "feasible" if trial.feasible else "infeasible"
    return "pruned" if trial.state == "pruned" else "failed"


def _point(
    trial: Trial,
    value: float | None,
    unit: ScoreUnit,
    interval: tuple[float | None, float | None],
    truth: Mapping[int, float],
    reprojection: Mapping[int, float],
) -> TrialPoint:
    known = trial.feasible is True and trial.gtf_ate is not None
    return TrialPoint(
        number=trial.number,
        state=state_of(trial),
        options=trial.options or {},
        value=unit.shown(value) if known else math.nan,
        low=unit.shown(interval[0]) if known else math.nan,
        high=unit.shown(interval[1]) if known else math.nan,
        ground_truth=truth.get(trial.number, math.nan),
        reprojection_px=reprojection.get(trial.number, math.nan),
        coverage=stored_number(trial.coverage),
        collapsed=stored_number(trial.collapsed_rate),
        noisy_runs=trial.noisy_runs,
        wall_s=trial.wall_s,
        message=trial.message,
    )


def _truth(data: StudyData, sequence: str) -> dict[int, float]:
    return {
        number: error.value
        for number, found in data.validations.items()
        for error in found
        if error.sequence_name == sequence and error.value is not None
    }


def _combined_truth(data: StudyData) -> dict[int, float]:
    """Return the geometric mean over sequences of true error / that of nominal, as scores are combined."""
    by_sequence = [_truth(data, sequence.name) for sequence in data.sequences]
    usable = [errors for errors in by_sequence if errors.get(0, 0.0) > 0]
    numbers = set.intersection(*(set(errors) for errors in usable)) if usable else set()
    return {
        number: _geometric_mean(errors[number] / errors[0] for errors in usable)
        for number in numbers
        if all(errors[number] > 0 for errors in usable)
    }


def _geometric_mean(values: Iterable[float]) -> float:
    return math.exp(fmean(math.log(value) for value in values))


def _reprojection(data: StudyData, sequences: set[str]) -> dict[int, float]:
    """Return the mean reprojection error in pixels over the clean runs of each trial that reported one."""
    found: dict[int, list[float]] = {}
    for use in data.runs:
        value = use.run.diagnostics.get(_REPROJECTION)
        if use.run.kind == "clean" and use.sequence_name in sequences and isinstance(value, int | float):
            found.setdefault(use.number, []).append(float(value))
    return {number: fmean(values) for number, values in found.items()}
