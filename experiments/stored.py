"""Read outcomes back from docs/results.json, so that results grow over machines whose databases are not at hand."""

import json
import math
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from experiments.estimators import paired_ratio
from experiments.fresh import FreshError
from experiments.joint import Joint
from experiments.k_delta import Curve
from experiments.ladder import Ladder, Rung
from experiments.plan import Experiment
from experiments.settings import Outcome, Setting
from experiments.several import Candidate, OnSequence
from gtf_tune.trajectory import FloatArray

_GROUPS = ("experiments", "weaker_noise", "traps", "ablation", "many")


def stored_results(file: Path) -> dict[str, Mapping[str, Any]]:
    """Return what a file written by `write_results` holds of each study, by its name; nothing without the file."""
    if not file.exists():
        return {}
    data = json.loads(file.read_text(encoding="utf-8"))
    return {one["study"]: one for group in _GROUPS for one in data.get(group, ())}


def stored_curves(file: Path) -> list[Curve]:
    """Return the curves over the number of noisy runs that a file holds."""
    return [Curve(one["study"], tuple(one["counts"]), one["r_squared"]) for one in _group(file, "k_delta")]


def stored_ladders(file: Path) -> list[Ladder]:
    """Return the noise ladders that a file holds."""
    return [_ladder(one) for one in _group(file, "ladders")]


def stored_joints(file: Path) -> list[Joint]:
    """Return the joint searches that a file holds."""
    return [Joint(**one) for one in _group(file, "joint")]


def stored_candidates(file: Path) -> list[Candidate]:
    """Return the candidates of the search over several sequences that a file holds."""
    return [
        Candidate(
            **{
                **one,
                "reasons": tuple(one["reasons"]),
                "by_sequence": tuple(OnSequence(**on) for on in one["by_sequence"]),
            }
        )
        for one in _group(file, "several")
    ]


def stored_fresh(file: Path) -> list[FreshError]:
    """Return the candidates of confirmations, judged on their own noise, that a file holds."""
    numbers = ("score", "change", "low", "high", "clean")
    return [FreshError(**{**one, **{name: _number(one[name]) for name in numbers}}) for one in _group(file, "fresh")]


def _ladder(stored: Mapping[str, Any]) -> Ladder:
    rungs = tuple(_rung(one) for one in stored.get("rungs") or stored["levels"])
    return Ladder(stored["sequence"], stored["floor"], rungs, stored["recommended"])


def _group(file: Path, name: str) -> list[Mapping[str, Any]]:
    return list(json.loads(file.read_text(encoding="utf-8")).get(name, ())) if file.exists() else []


def _rung(level: Mapping[str, Any]) -> Rung:
    return Rung(
        level["sigma"],
        level["score"],
        level.get("spread"),
        level["collapsed"],
        level.get("linear"),
        level["true_ate"],
    )


def outcome_from(stored: Mapping[str, Any], experiment: Experiment) -> Outcome:
    """Return the outcome of an experiment; estimators that the file does not have are NaN."""
    rows = stored["settings"]
    matrices = [_matrix(row["matrix"]) for row in rows]
    settings = tuple(
        _setting(number, row, matrix, matrices[0])
        for number, (row, matrix) in enumerate(zip(rows, matrices, strict=True))
    )
    adopted = next((setting for setting in settings if setting.value == stored["adopted"]), None)
    return Outcome(experiment, settings, adopted, stored["verdict"])


def _setting(number: int, row: Mapping[str, Any], matrix: FloatArray, nominal: FloatArray) -> Setting:
    return Setting(
        number=number,
        value=row["value"],
        feasible=row["feasible"],
        coverage=row["coverage"],
        true_ate=_number(row["true_ate"]),
        noisy_true_ates=np.array([_number(value) for value in row.get("noisy_true_ates", ())]),
        matrix=matrix,
        collapsed=row["collapsed"],
        clean_clean=_number(row["clean_clean"]),
        noisy_noisy=_number(row.get("noisy_noisy")),
        dispersion=_number(row.get("dispersion")),
        paired=paired_ratio(nominal, matrix),
        reprojection_px=_number(row["reprojection_px"]),
    )


def _matrix(rows: list[list[float | None]]) -> FloatArray:
    return np.array([[_number(value) for value in row] for row in rows], dtype=np.float64)


def _number(value: float | None) -> float:
    return math.nan if value is None else float(value)
