"""The matrices that are stored with a trial."""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from gtf_tune.report.study_data import StudyData
from gtf_tune.study.scoring.coverage import CoverageFloor, coverage_floor
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
    return coverage_floor(clean, stored.get("coverage_noisy") or [], data.definition.gtf.coverage_floor)


def stored_number(value: Any) -> float:
    """Return a number as it is stored, NaN where that is None."""
    return math.nan if value is None else float(value)


def _matrix(rows: Sequence[Sequence[float | None]]) -> FloatArray:
    matrix = np.array([[stored_number(value) for value in row] for row in rows], dtype=np.float64)
    return matrix if matrix.ndim == 2 else matrix.reshape(0, 0)


def _pair(key: str) -> tuple[int, int]:
    first, _, second = key.partition(",")
    return int(first), int(second)
