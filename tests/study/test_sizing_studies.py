from pathlib import Path

import numpy as np
import optuna
import pytest
from optuna.trial import TrialState

from gtf_tune.execution import InlineExecutor
from gtf_tune.store import studies, trials
from gtf_tune.store.database import Database, create_database
from gtf_tune.store.maintenance.digest import study_digest
from gtf_tune.store.optuna.tables import optuna_storage
from gtf_tune.study.create import checked_definition, create_study
from gtf_tune.study.open_study import open_study
from gtf_tune.study.scoring.savings import runs_saved
from gtf_tune.study.work.worker import StudyWorker
from tests.study.conftest import Runner, definition_of
from tests.study.stopping import StopAfter

GRID = {"filter.max_error": {"values": [0.0014, 0.0013, 0.09]}}
ADAPTIVE = {"noisy_runs": {"min": 3, "max": 9}, "aggregate": "median"}


def _trials(database: Database) -> list[trials.Trial]:
    return trials.of_study(database, studies.get(database, "small").id)


def _efforts(database: Database) -> list[trials.Effort]:
    return trials.efforts(database, studies.get(database, "small").id)


def _optuna(database: Database) -> optuna.Study:
    return optuna.load_study(study_name="small", storage=optuna_storage(database))


@pytest.fixture
def raced(room: Path, database: Database, run_study: Runner) -> Database:
    """A grid of a good, an equally good and a hopeless setting."""
    run_study(definition_of(room, space=GRID, gtf=ADAPTIVE, search={"sampler": "grid", "trials": None}))
    return database


def test_hopeless_trials_stop_early_and_competitors_do_not(raced: Database) -> None:
    assert [(trial.state, trial.noisy_runs) for trial in _trials(raced)] == [
        ("complete", 9),
        ("complete", 9),
        ("complete", 9),
        ("pruned", 3),
    ]


def test_a_stopped_trial_keeps_the_honest_score_of_its_runs_and_says_why(raced: Database) -> None:
    stopped = _trials(raced)[3]
    detail = trials.details(raced, [stopped.id])[stopped.id]

    assert stopped.value == stopped.gtf_ate == np.median(detail["sequences"]["room"]["matrix"])
    assert len(detail["instances"]) == 3
    assert "worse than the best trial on 3 noisy runs" in stopped.message
    assert stopped.feasible


def test_optuna_sees_a_stopped_trial_as_pruned_with_the_same_value(raced: Database) -> None:
    ours, theirs = _trials(raced)[3], _optuna(raced).trials[3]

    assert theirs.state == TrialState.PRUNED
    assert theirs.value == ours.value
    assert theirs.user_attrs["stopped_early"] is True
    assert len(theirs.intermediate_values) == 3


def test_a_lucky_start_cannot_be_picked(room: Path, database: Database, run_study: Runner) -> None:
    # The mean over all runs of the complete trials holds a collapsed one, so early means look a hundred times smaller.
    collapsing = {"settings": {"collapse_rate": "0.12"}}
    gtf = {"noisy_runs": {"min": 3, "max": 12}, "aggregate": "mean"}
    run_study(
        definition_of(
            room, pipeline=collapsing, space=GRID, gtf=gtf, search={"sampler": "grid", "trials": None, "seed": 5}
        )
    )
    found = _trials(database)
    best = trials.best(database, studies.get(database, "small").id)

    assert best is not None
    assert any(trial.state == "pruned" and (trial.value or 1) < (best.value or 0) for trial in found)
    assert best.noisy_runs == 12
    assert _optuna(database).best_trial.number == best.optuna_number


def test_savings_count_what_stopping_early_spared(raced: Database) -> None:
    definition = checked_definition(
        definition_of(Path("room"), space=GRID, gtf=ADAPTIVE, search={"sampler": "grid", "trials": None}), "test"
    )

    saved = runs_saved(_efforts(raced), definition)

    assert (saved.full, saved.asked, saved.by_sizing) == (44, 38, 6)
    assert (saved.by_pruner, saved.by_coverage) == (0, 0)
    assert saved.share == pytest.approx(6 / 44)


def test_infeasible_trials_count_as_spared_by_coverage(room: Path, database: Database, run_study: Runner) -> None:
    data = definition_of(
        room, space={"filter.max_error": {"values": [1e-6]}}, search={"sampler": "grid", "trials": None}
    )
    run_study(data)

    saved = runs_saved(_efforts(database), checked_definition(data, "test"))

    assert (saved.full, saved.by_sizing, saved.by_coverage) == (10, 0, 3)


@pytest.mark.parametrize("sampler", ["tpe", "refine"])
def test_an_interrupted_adaptive_study_makes_the_same_decisions(
    sampler: str, room: Path, tmp_path: Path, database: Database, run_study: Runner
) -> None:
    data = definition_of(room, gtf=ADAPTIVE, search={"sampler": sampler, "trials": 7})
    undisturbed = create_database(str(tmp_path / "undisturbed.db"))
    create_study(undisturbed, checked_definition(data, "test"), tmp_path)
    whole = InlineExecutor()
    StudyWorker(open_study(undisturbed, "small"), whole).work()

    executed = 0
    for _ in range(16):
        stopping = StopAfter(5)
        executed += len(run_study(data, stop=stopping.stop, callbacks=[stopping]).executed)

    assert executed == len(whole.executed)
    assert study_digest(database, "small") == study_digest(undisturbed, "small")


def test_the_wilcoxon_pruner_stops_trials_and_is_accounted_for(
    room: Path, database: Database, run_study: Runner
) -> None:
    data = definition_of(
        room,
        space=GRID,
        gtf={"noisy_runs": 12, "aggregate": "median"},
        search={"sampler": "grid", "trials": None, "pruner": "wilcoxon"},
    )
    run_study(data)

    stopped = _trials(database)[3]
    saved = runs_saved(_efforts(database), checked_definition(data, "test"))

    assert (stopped.state, stopped.noisy_runs) == ("pruned", 6)
    assert "pruner" in stopped.message
    assert saved.by_pruner >= 6
    assert saved.by_sizing == 0
