from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from gtf_tune.errors import DefinitionError
from gtf_tune.store.database import Database
from gtf_tune.store.maintenance.digest import study_digest
from gtf_tune.study.scoring.rescore import Rescored, rescore
from tests.study.conftest import Runner, definition_of, write_sequence

GRID: Mapping[str, Any] = {
    "space": {"filter.max_error": {"values": [0.01, 0.002, 0.05]}},
    "search": {"sampler": "grid"},
    "gtf": {"noisy_runs": 6},
}


def _values(found: Rescored) -> list[float]:
    return [one.score.value for one in found.trials]


def test_without_changes_the_stored_scores_come_out(room: Path, database: Database, run_study: Runner) -> None:
    run_study(definition_of(room, **GRID))

    found = rescore(database, "small", {})

    assert _values(found) == [one.trial.value for one in found.trials]
    assert [one.rank for one in found.trials] == [one.rank_before for one in found.trials]


def test_another_aggregate_gives_what_a_study_with_it_would_have_scored(
    room: Path, database: Database, run_study: Runner
) -> None:
    run_study(definition_of(room, **GRID))
    run_study({**definition_of(room, **{**GRID, "gtf": {"noisy_runs": 6, "aggregate": "gmean"}}), "name": "gmean"})

    assert _values(rescore(database, "small", {"aggregate": "gmean"})) == _values(rescore(database, "gmean", {}))


def test_several_sequences_stay_relative_to_nominal(
    room: Path, tmp_path: Path, database: Database, run_study: Runner
) -> None:
    other = write_sequence(tmp_path / "other", ground_truth=False, frames=9)
    both = [{"name": "room", "path": str(room)}, {"name": "other", "path": str(other)}]
    run_study(definition_of(room, sequences=both, **GRID))

    found = rescore(database, "small", {"aggregate": "median"})

    assert found.trials[0].score.value == pytest.approx(1.0)
    assert found.best is not None
    scores = [one.score for one in found.best.score.by_sequence.values()]
    nominal = [one.score for one in found.trials[0].score.by_sequence.values()]
    ratios = [one.value / base.value for one, base in zip(scores, nominal, strict=True) if one and base]
    assert found.best.score.value == pytest.approx(float(np.sqrt(np.prod(ratios))))


def test_the_study_is_left_as_it_was(room: Path, database: Database, run_study: Runner) -> None:
    run_study(definition_of(room, **GRID))
    before = study_digest(database, "small")

    rescore(database, "small", {"metric": "rpe_rotation", "normalise": "none"})

    assert study_digest(database, "small") == before


def test_what_needs_other_runs_is_refused(room: Path, database: Database, run_study: Runner) -> None:
    run_study(definition_of(room, **GRID))

    with pytest.raises(DefinitionError, match="noise_sigma cannot be changed without new runs"):
        rescore(database, "small", {"noise_sigma": 2.0})


def test_an_unknown_aggregate_is_refused_with_the_known_ones(room: Path, database: Database, run_study: Runner) -> None:
    run_study(definition_of(room, **GRID))

    with pytest.raises(DefinitionError, match="'median'"):
        rescore(database, "small", {"aggregate": "mode"})
