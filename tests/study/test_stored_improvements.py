"""The improvement of a trial is stored when it ends, so that reading a study computes nothing."""

import sys
from pathlib import Path

import pytest
from sqlalchemy import update

from gtf_tune.store import studies, trials
from gtf_tune.store.database import Database, models
from gtf_tune.store.database.session import write
from gtf_tune.store.optuna.tables import optuna_storage
from gtf_tune.study.outcome.improvement import paired_improvement, read_improvements, stored_matrices
from tests.study.conftest import Runner, definition_of, write_sequence

GRID = {
    "pipeline": {"settings": {"collapse_rate": 0.0}},
    "space": {"filter.max_error": {"values": [0.01, 0.002, 0.05]}},
    "gtf": {"noisy_runs": 6},
    "search": {"sampler": "grid"},
}


def test_what_is_stored_is_the_paired_improvement(room: Path, database: Database, run_study: Runner) -> None:
    run_study(definition_of(room, **GRID))
    study = studies.get(database, "small")
    known = trials.of_study(database, study.id)
    details = trials.details(database, [one.id for one in known])
    matrices = {one.number: stored_matrices(details[one.id]) for one in known}

    found = read_improvements(database, study.id, known)

    assert found == {number: paired_improvement(matrices[0], matrices[number]) for number in (1, 2)}
    best = trials.best(database, study.id)
    assert best is not None
    assert found[best.number].low < found[best.number].value < found[best.number].high
    attributes = {
        one.number: one.user_attrs.get("improvement_percent")
        for one in optuna_storage(database).get_all_trials(study.optuna_study_id)
    }
    assert attributes == {0: None, **{number: round(100 * one.value, 2) for number, one in found.items()}}


def test_reading_a_stored_improvement_needs_no_numpy(
    room: Path, database: Database, run_study: Runner, monkeypatch: pytest.MonkeyPatch
) -> None:
    run_study(definition_of(room, **GRID))
    study = studies.get(database, "small")
    monkeypatch.setitem(sys.modules, "numpy", None)

    assert set(read_improvements(database, study.id, trials.of_study(database, study.id))) == {1, 2}


def test_an_improvement_that_an_earlier_version_did_not_store_is_computed(
    room: Path, tmp_path: Path, database: Database, run_study: Runner
) -> None:
    other = write_sequence(tmp_path / "other", ground_truth=False, frames=9)
    both = [{"name": "room", "path": str(room)}, {"name": "other", "path": str(other)}]
    run_study(definition_of(room, sequences=both, **GRID))
    study = studies.get(database, "small")
    known = trials.of_study(database, study.id)
    before = read_improvements(database, study.id, known)

    for trial_id, detail in trials.details(database, [one.id for one in known]).items():
        old = {key: value for key, value in detail.items() if key != "improvement"}
        statement = update(models.Trial).where(models.Trial.id == trial_id).values(detail=old)
        write(database, lambda session, statement=statement: session.execute(statement).close())

    assert all(one.instances == 12 for one in before.values())
    assert read_improvements(database, study.id, known) == before


def test_an_infeasible_trial_and_nominal_have_no_improvement(room: Path, database: Database, run_study: Runner) -> None:
    strict = {"filter.max_error": {"values": [0.01, 1e-6, 0.002]}}
    run_study(definition_of(room, **{**GRID, "space": strict}))
    study = studies.get(database, "small")
    known = trials.of_study(database, study.id)

    assert [one.feasible for one in known] == [True, False, True]
    assert set(read_improvements(database, study.id, known)) == {2}
