import math
from pathlib import Path
from typing import Any, ClassVar

import optuna
import pytest
from optuna.samplers import RandomSampler
from optuna.trial import FrozenTrial, TrialState

from gtf_tune.execution import InlineExecutor
from gtf_tune.store import ground_truth_errors, runs, studies, trials
from gtf_tune.store.database import Database, create_database
from gtf_tune.store.maintenance.digest import study_digest
from gtf_tune.store.optuna import trials as optuna_trials
from gtf_tune.store.optuna.tables import optuna_storage
from gtf_tune.store.trial_queue import this_worker
from gtf_tune.study.create import checked_definition, create_study
from gtf_tune.study.events import Event, TrialStarted
from gtf_tune.study.open_study import open_study
from gtf_tune.study.work.worker import StudyWorker
from tests.study.conftest import Runner, definition_of, write_sequence
from tests.study.stopping import StopAfter


def _trials(database: Database) -> list[trials.Trial]:
    return trials.of_study(database, studies.get(database, "small").id)


def test_trial_zero_is_nominal_and_the_budget_is_exact(room: Path, database: Database, run_study: Runner) -> None:
    run_study(definition_of(room))

    found = _trials(database)

    assert [trial.number for trial in found] == list(range(8))
    assert found[0].options == {"filter.max_error": 0.01}
    assert studies.get(database, "small").state == "done"


def test_a_grid_tries_nominal_and_every_point_once(room: Path, database: Database, run_study: Runner) -> None:
    run_study(
        definition_of(room, space={"filter.max_error": {"values": [0.001, 0.01, 0.1]}}, search={"sampler": "grid"})
    )

    assert [trial.options["filter.max_error"] for trial in _trials(database) if trial.options] == [0.01, 0.001, 0.1]


def test_every_trial_runs_k_plus_k_delta_times_and_stores_each_run(
    room: Path, database: Database, run_study: Runner
) -> None:
    executor = run_study(definition_of(room))

    uses = runs.of_study(database, studies.get(database, "small").id)

    assert len(executor.executed) == 8 * (2 + 3) == len(uses)
    assert {(use.run.kind, use.run.index) for use in uses if use.number == 4} == {
        ("clean", 0),
        ("clean", 1),
        ("noisy", 0),
        ("noisy", 1),
        ("noisy", 2),
    }


def test_a_run_that_failed_is_tried_again_under_other_limits_only(
    room: Path, database: Database, run_study: Runner
) -> None:
    failing = {"name": "analytic", "settings": {"failure": "memory"}}
    data = definition_of(room, pipeline=failing, search={"trials": 1}, limits={"run_memory_gb": 0.5})
    first = run_study(data)
    same = run_study({**data, "name": "same"})
    raised = run_study({**data, "name": "raised", "limits": {"run_memory_gb": 0.6}})

    assert len(first.executed) == len(raised.executed) == 2  # of nominal, whose clean runs fail
    assert same.executed == []
    assert {run.run.error for run in runs.of_study(database, studies.get(database, "small").id)} == {
        "the run needed more than its memory limit of 0.5 GB"
    }


def test_a_second_study_reuses_the_runs_of_the_first(room: Path, run_study: Runner) -> None:
    run_study(definition_of(room))

    executor = run_study(definition_of(room, name="again"))

    assert executor.executed == []


def test_raising_k_delta_runs_only_what_is_new(room: Path, run_study: Runner) -> None:
    grid = {"space": {"filter.max_error": {"values": [0.001, 0.01]}}, "search": {"sampler": "grid"}}
    run_study(definition_of(room, **grid))

    executor = run_study(definition_of(room, name="more", gtf={"noisy_runs": 5}, **grid))

    assert {(one.kind, one.index) for one in executor.executed} == {("noisy", 3), ("noisy", 4)}


@pytest.mark.parametrize("sampler", ["tpe", "qmc", "random", "optuna.samplers:NSGAIISampler", "grid"])
def test_an_interrupted_study_goes_on_as_if_it_had_never_stopped(
    sampler: str, room: Path, tmp_path: Path, database: Database, run_study: Runner
) -> None:
    data = definition_of(
        room,
        space={
            "filter.max_error": {"low": 3e-4, "high": 0.1, "log": True, "points": 3},
            "robust.scale": {"low": 0.01, "high": 10.0, "log": True, "points": 3},
        },
        search={"sampler": sampler, "trials": 7},
    )
    undisturbed = create_database(str(tmp_path / "undisturbed.db"))
    create_study(undisturbed, checked_definition(data, "test"), tmp_path)
    StudyWorker(open_study(undisturbed, "small"), InlineExecutor()).work()

    executed = 0
    for _ in range(11):
        stopping = StopAfter(4)
        executor = run_study(data, stop=stopping.stop, callbacks=[stopping])
        executed += len(executor.executed)

    assert executed == 7 * 5
    assert study_digest(database, "small") == study_digest(undisturbed, "small")


def test_tpe_goes_on_after_its_start_up_trials_as_if_it_had_never_stopped(
    room: Path, tmp_path: Path, database: Database, run_study: Runner
) -> None:
    few = {"clean_runs": 1, "noisy_runs": 2}
    data = definition_of(room, gtf=few, search={"sampler": "tpe", "trials": 14})
    undisturbed = create_database(str(tmp_path / "undisturbed.db"))
    create_study(undisturbed, checked_definition(data, "test"), tmp_path)
    StudyWorker(open_study(undisturbed, "small"), InlineExecutor()).work()

    stopping = StopAfter(3 * 11)
    run_study(data, stop=stopping.stop, callbacks=[stopping])
    run_study(data)

    assert study_digest(database, "small") == study_digest(undisturbed, "small")


class _Onlooker(RandomSampler):
    """Note how many ended trials Optuna shows to the samplers that learn from them, when a trial is begun."""

    seen: ClassVar[list[int]] = []

    def sample_independent(self, study: optuna.Study, trial: FrozenTrial, *axis: Any) -> Any:
        ended = study._get_trials(deepcopy=False, states=[TrialState.COMPLETE], use_cache=True)
        self.seen.append(len(ended))
        return super().sample_independent(study, trial, *axis)


def test_samplers_learn_from_every_trial_that_has_ended(
    room: Path, run_study: Runner, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(_Onlooker, "seen", [])
    monkeypatch.setattr("gtf_tune.study.work.trial_runner.make_sampler", lambda *_: _Onlooker())

    run_study(definition_of(room, search={"trials": 5}))

    assert _Onlooker.seen == [1, 2, 3, 4]


def test_a_study_makes_the_same_trials_with_and_without_ground_truth(
    room: Path, tmp_path: Path, database: Database, run_study: Runner
) -> None:
    blind = write_sequence(tmp_path / "blind", ground_truth=False)
    run_study(definition_of(room))
    run_study(definition_of(blind, name="blind"))

    seen, unseen = _trials(database), trials.of_study(database, studies.get(database, "blind").id)

    assert [(one.options, one.value, one.feasible) for one in seen] == [
        (one.options, one.value, one.feasible) for one in unseen
    ]
    assert len(ground_truth_errors.of_study(database, studies.get(database, "small").id)) == 8
    assert ground_truth_errors.of_study(database, studies.get(database, "blind").id) == {}


def test_optuna_sees_the_same_values_constraints_and_instances(
    room: Path, database: Database, run_study: Runner
) -> None:
    run_study(definition_of(room))
    study = optuna.load_study(study_name="small", storage=optuna_storage(database))

    for ours, theirs in zip(_trials(database), study.trials, strict=True):
        assert theirs.value == ours.value
        assert theirs.params == ours.options
        assert len(theirs.intermediate_values) == 3
        assert theirs.user_attrs["gtf_ate"] == ours.gtf_ate
        assert theirs.user_attrs["gt_ate"] > 0
    assert study.best_trial.number == trials.best(database, studies.get(database, "small").id).optuna_number


def test_a_setting_that_loses_frames_is_infeasible_and_worse_than_every_feasible_one(
    room: Path, database: Database, run_study: Runner
) -> None:
    run_study(definition_of(room, space={"filter.max_error": {"values": [1e-6, 0.005]}}, search={"sampler": "grid"}))

    nominal, strict, loose = _trials(database)

    assert not strict.feasible
    assert strict.value is not None
    assert strict.value >= 1 > max(nominal.value or 0, loose.value or 0)
    assert "frames" in strict.message


def test_a_run_that_fails_is_data_and_the_study_goes_on(room: Path, database: Database, run_study: Runner) -> None:
    run_study(
        definition_of(room, pipeline={"settings": {"failure": "error", "failure_rate": "0.4"}}, search={"trials": 6})
    )

    found = _trials(database)

    assert len(found) == 6
    assert {trial.state for trial in found} == {"complete"}
    assert any(not trial.feasible and "told to fail" in trial.message for trial in found)


def test_the_trial_of_a_dead_worker_is_adopted_with_its_optuna_trial(
    room: Path, database: Database, run_study: Runner
) -> None:
    create_study(database, checked_definition(definition_of(room), "test"), room)
    study_id = studies.get(database, "small").id
    dead = this_worker("dead")
    from gtf_tune.store import trial_queue

    lease = trial_queue.lease_trial(database, study_id, 8, dead)
    assert lease is not None
    trial_queue.release(database, lease)

    run_study(definition_of(room))

    assert [(trial.number, trial.attempts) for trial in _trials(database)][:2] == [(0, 2), (1, 1)]
    assert len(optuna.load_study(study_name="small", storage=optuna_storage(database)).trials) == 8


def test_a_trial_that_someone_ends_in_optuna_goes_on_in_another_one(
    room: Path, database: Database, run_study: Runner
) -> None:
    data = definition_of(room, search={"sampler": "random", "trials": 3})
    stopping = StopAfter(12)
    run_study(data, stop=stopping.stop, callbacks=[stopping])
    begun = _trials(database)[2]
    study = optuna.load_study(study_name="small", storage=optuna_storage(database))
    study.tell(2, state=TrialState.FAIL)

    executor = run_study(data)

    last = _trials(database)[2]
    assert (last.state, last.options, last.optuna_number, len(executor.executed)) == ("complete", begun.options, 3, 3)
    assert [trial.state.name for trial in study.trials] == ["COMPLETE", "COMPLETE", "FAIL", "COMPLETE"]


def test_a_trial_that_someone_ends_in_optuna_while_it_runs_is_given_back_at_once(
    room: Path, database: Database, run_study: Runner
) -> None:
    def meddle(event: Event) -> None:
        if isinstance(event, TrialStarted) and event.number == 1:
            study = optuna.load_study(study_name="small", storage=optuna_storage(database))
            if len(study.trials) == 2:
                study.tell(1, state=TrialState.FAIL)

    run_study(definition_of(room, search={"sampler": "random", "trials": 3}), callbacks=[meddle])

    assert [(trial.state, trial.attempts) for trial in _trials(database)] == [
        ("complete", 1),
        ("complete", 2),
        ("complete", 1),
    ]


def test_several_sequences_are_scored_relative_to_nominal(
    room: Path, tmp_path: Path, database: Database, run_study: Runner
) -> None:
    hall = write_sequence(tmp_path / "hall", ground_truth=False, frames=9)
    both = [{"name": "room", "path": str(room)}, {"name": "hall", "path": str(hall)}]
    run_study(definition_of(room, sequences=both))

    nominal, second = _trials(database)[:2]
    detail = trials.details(database, [nominal.id, second.id])
    ratios = [
        detail[second.id]["sequences"][name]["value"] / detail[nominal.id]["sequences"][name]["value"]
        for name in ("room", "hall")
    ]

    assert nominal.value == 1.0
    assert second.value == pytest.approx(math.sqrt(ratios[0] * ratios[1]), rel=1e-12)


def test_a_trial_has_one_optuna_trial_however_often_it_is_created(
    room: Path, database: Database, run_study: Runner
) -> None:
    run_study(definition_of(room, search={"sampler": "random", "trials": 2}))
    study = optuna.load_study(study_name="small", storage=optuna_storage(database))

    first, second = (optuna_trials.create_for_number(study, 7, {"filter.max_error": 0.01}) for _ in range(2))

    assert first == second
    assert [trial.number for trial in study.get_trials(states=[optuna.trial.TrialState.WAITING])] == [2]
