"""Ground truth beside the search: any metric, the same trials, and recomputed without a run."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest

from gtf_tune.definition import SideMetricDefinition
from gtf_tune.errors import DefinitionError, SequenceError
from gtf_tune.metrics import RpeSettings, rpe
from gtf_tune.pipelines import analytic
from gtf_tune.store import ground_truth_errors, runs, studies, trials
from gtf_tune.store.database import Database
from gtf_tune.store.ground_truth_errors import Validation
from gtf_tune.store.maintenance.digest import study_digest
from gtf_tune.store.runs import trajectories
from gtf_tune.study.ground_truth.record import changed_side_metric, recompute_side_metric
from tests.study.conftest import FRAMES, Runner, definition_of, write_sequence

RPE = {"metric": "rpe_translation", "rpe_delta": 0.2, "rpe_delta_unit": "seconds", "rpe_pairs": "consecutive"}
SHORT: dict[str, Any] = {"search": {"trials": 3}}


def _recorded(database: Database, name: str) -> dict[int, list[Validation]]:
    return ground_truth_errors.of_study(database, studies.get(database, name).id)


def test_the_side_metric_changes_no_trial(room: Path, tmp_path: Path, database: Database, run_study: Runner) -> None:
    blind = write_sequence(tmp_path / "blind", ground_truth=False)
    run_study(definition_of(room, side_metric=RPE))
    run_study(definition_of(room, name="absolute"))
    run_study(definition_of(blind, name="blind"))

    found = [
        [(one.options, one.value, one.feasible) for one in trials.of_study(database, studies.get(database, name).id)]
        for name in ("small", "absolute", "blind")
    ]

    assert found[0] == found[1] == found[2]


def test_the_error_asked_for_is_stored_under_its_name(room: Path, database: Database, run_study: Runner) -> None:
    run_study(definition_of(room, side_metric=RPE, **SHORT))
    study = studies.get(database, "small")
    keys = [use.run.key for use in runs.of_study(database, study.id) if (use.number, use.run.kind) == (1, "clean")]
    settings = RpeSettings("translation", 0.2, "seconds", "consecutive")
    truth = analytic.ground_truth(range(FRAMES))

    stored = _recorded(database, "small")[1][0]

    errors = [rpe(truth, one, settings) for one in trajectories(database, keys).values()]
    assert stored.value == pytest.approx(np.mean(errors))
    assert (stored.metrics["metric"], stored.metrics["unit"], stored.ate) == ("rpe_translation", "GT unit", None)


@pytest.mark.parametrize(
    "side",
    [RPE, {"metric": "rpe_rotation", "rpe_delta": 3}, {"alignment": "se3"}, {"alignment": "none"}],
    ids=["translation", "rotation", "se3", "none"],
)
def test_stored_trajectories_give_what_a_study_with_that_metric_records(
    side: dict[str, Any], room: Path, database: Database, run_study: Runner
) -> None:
    run_study(definition_of(room, **SHORT))
    before = study_digest(database, "small")
    changed = changed_side_metric(SideMetricDefinition(), side)

    found = recompute_side_metric(database, "small", changed)

    executor = run_study(definition_of(room, name="asked", side_metric=side, **SHORT))
    assert found == _recorded(database, "asked")
    assert executor.executed == []
    assert study_digest(database, "small") == before


def test_ground_truth_that_lies_elsewhere_is_asked_for_by_its_flag(
    room: Path, database: Database, run_study: Runner
) -> None:
    run_study(definition_of(room, **SHORT))
    room.rename(room.with_name("moved"))

    with pytest.raises(SequenceError, match="say where"):
        recompute_side_metric(database, "small", SideMetricDefinition())


def test_without_ground_truth_there_is_nothing_to_recompute(
    tmp_path: Path, database: Database, run_study: Runner
) -> None:
    run_study(definition_of(write_sequence(tmp_path / "blind", ground_truth=False), **SHORT))

    with pytest.raises(DefinitionError, match="no sequence with ground truth"):
        recompute_side_metric(database, "small", SideMetricDefinition())


def test_a_side_metric_that_does_not_exist_is_refused() -> None:
    with pytest.raises(DefinitionError, match="whole number of frames"):
        changed_side_metric(SideMetricDefinition(), {"metric": "rpe_translation", "rpe_delta": 1.5})
