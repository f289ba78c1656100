from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace

import pytest

from gtf_tune.errors import StorageError
from gtf_tune.pipelines.run import RunOutcome, RunRequest
from gtf_tune.store import confirmations, ground_truth_errors, runs, studies, trial_queue, trials
from gtf_tune.store.database import Database
from gtf_tune.store.ground_truth_errors import Validation
from gtf_tune.store.optuna.tables import optuna_storage
from gtf_tune.store.runs import StoredRun, TrialRun
from gtf_tune.store.studies import NewStudy, Study
from gtf_tune.store.trial_queue import TrialResult, this_worker

MakeStudy = Callable[..., Study]


def run_trial(database: Database, study: Study, value: float, **result: object) -> int:
    lease = trial_queue.lease_trial(database, study.id, 100, this_worker())
    assert lease is not None
    ended = TrialResult("complete", value=value, feasible=True, gtf_ate=value, wall_s=2.0, detail={"m": [value]})
    assert trial_queue.finish(database, lease, replace(ended, **result))
    return lease.trial_id


def test_a_study_is_kept_with_its_sequences(database: Database, make_study: MakeStudy) -> None:
    added = make_study(database, "room")
    assert studies.get(database, "room") == added
    assert (added.state, added.definition, added.resolved, added.root) == (
        "open",
        '{"name":"room"}',
        {"sigma": 5.0},
        "/data",
    )
    (sequence,) = studies.sequences(database, added.id)
    assert (sequence.name, sequence.has_ground_truth, sequence.info) == ("desk", False, {"note": 1})


def test_of_several_that_add_a_study_at_once_one_succeeds(database: Database) -> None:
    new = NewStudy("room", 1, "{}", {}, "", ())

    def add(_: int) -> str:
        try:
            return studies.add(database, new).name
        except StorageError as error:
            return str(error)

    with ThreadPoolExecutor(6) as pool:
        said = list(pool.map(add, range(6)))
    assert said.count("room") == 1
    assert sum("study 'room' exists already" in one and "resume or delete it" in one for one in said) == 5


def test_an_unknown_study_shows_near_names(database: Database, make_study: MakeStudy) -> None:
    make_study(database, "fountain")
    with pytest.raises(StorageError, match=r"no study 'fontain' in .*did you mean 'fountain'\?"):
        studies.get(database, "fontain")


def test_summaries_count_trials_by_state(database: Database, make_study: MakeStudy) -> None:
    study, other = make_study(database, "a"), make_study(database, "b")
    for value, result in [(0.5, {}), (0.25, {}), (0.1, {"feasible": False}), (0.2, {"state": "pruned"})]:
        run_trial(database, study, value, **result)
    trial_queue.lease_trial(database, study.id, 100, this_worker())

    first, second = studies.summaries(database)

    assert (first.trials, first.claimed, first.complete, first.infeasible, first.pruned) == (5, 1, 3, 1, 1)
    assert (first.best_value, first.nominal_value, first.wall_s) == (0.25, 0.5, 8.0)
    assert first.done == 4
    assert (second.name, second.trials, second.best_value, second.wall_s) == (other.name, 0, None, 0.0)


def test_the_penalty_of_an_infeasible_nominal_trial_is_no_value(database: Database, study: Study) -> None:
    run_trial(database, study, 2.0, feasible=False)
    run_trial(database, study, 0.5)

    (summary,) = studies.summaries(database)

    assert (summary.nominal_value, summary.best_value, summary.infeasible) == (None, 0.5, 1)


def test_the_best_trial_is_feasible_and_the_first_of_equals(database: Database, study: Study) -> None:
    assert trials.best(database, study.id) is None
    for value, feasible in [(0.5, True), (0.1, False), (0.3, True), (0.3, True)]:
        run_trial(database, study, value, feasible=feasible)
    best = trials.best(database, study.id)
    assert best is not None
    assert best.number == 2
    assert trials.details(database, [best.id]) == {best.id: {"m": [0.3]}}
    assert trials.counts(database, study.id) == {"complete": 4}


def test_trials_of_another_version_are_found_without_the_others(database: Database, study: Study) -> None:
    for detail in ({"m": [0.5]}, {"m": [0.4], "version_mismatch": "began with 1"}, {"versionXmismatch": "no"}):
        run_trial(database, study, 0.5, detail=detail)

    assert trials.version_mismatches(database, study.id) == {1: "began with 1"}
    assert trials.version_mismatches(database, study.id, {0, 1}) == {1: "began with 1"}
    assert trials.version_mismatches(database, study.id, {0}) == {}


def test_an_infinite_value_is_kept_and_nan_is_none(database: Database, study: Study) -> None:
    run_trial(database, study, float("inf"), standard_error=float("nan"))
    trial = trials.get(database, study.id, 0)
    assert (trial.value, trial.standard_error) == (float("inf"), None)


def test_a_trial_nobody_took_has_no_trial(database: Database, study: Study) -> None:
    with pytest.raises(StorageError, match="no trial 3"):
        trials.get(database, study.id, 3)


def test_workers_see_open_studies_only(database: Database, make_study: MakeStudy) -> None:
    first, second = make_study(database, "a"), make_study(database, "b")
    studies.set_state(database, first.id, "paused")
    assert [study.name for study in studies.open_studies(database)] == ["b"]
    studies.replace_definition(database, second.id, '{"trials":20}')
    assert studies.get(database, "b").definition == '{"trials":20}'


def test_trials_that_optuna_was_not_told_of_are_found(database: Database, study: Study) -> None:
    storage = optuna_storage(database)
    for told in (True, False):
        lease = trial_queue.lease_trial(database, study.id, 9, this_worker())
        assert lease is not None
        optuna_id = storage.create_new_trial(study.optuna_study_id)
        trial_queue.attach_optuna_trial(database, lease, optuna_id, lease.number, {})
        trial_queue.finish(database, lease, TrialResult("complete", value=1.0))
        if told:
            from optuna.trial import TrialState

            storage.set_trial_state_values(optuna_id, TrialState.COMPLETE, [1.0])
    assert [trial.number for trial in trials.untold(database, study.id)] == [1]


@pytest.fixture
def two_runs(
    database: Database, make_request: Callable[..., RunRequest], make_outcome: Callable[..., RunOutcome]
) -> tuple[StoredRun, StoredRun]:
    first, second = (runs.save(database, make_request("clean", index), make_outcome()) for index in (0, 1))
    return first, second


def test_deleting_a_study_keeps_the_runs_that_another_uses(
    database: Database, make_study: MakeStudy, two_runs: tuple[StoredRun, StoredRun]
) -> None:
    mine, shared = two_runs
    gone, kept = make_study(database, "gone"), make_study(database, "kept")
    trial_id = run_trial(database, gone, 0.5)
    runs.link(database, trial_id, [TrialRun(0, "desk", one, reused=False) for one in (mine, shared)])
    runs.link(database, run_trial(database, kept, 0.5), [TrialRun(0, "desk", shared, reused=True)])
    ground_truth_errors.save(database, trial_id, [Validation("desk", 0.1)])

    studies.delete_study(database, "gone")

    assert studies.names(database) == ["kept"]
    assert list(runs.find(database, [mine.key, shared.key])) == [shared.key]
    assert [study.study_name for study in optuna_storage(database).get_all_studies()] == ["kept"]
    assert len(runs.of_study(database, kept.id)) == 1


def test_deleting_a_study_keeps_the_runs_of_another_ones_confirmation(
    database: Database, make_study: MakeStudy, two_runs: tuple[StoredRun, StoredRun]
) -> None:
    mine, shared = two_runs
    gone, kept = make_study(database, "gone"), make_study(database, "kept")
    confirmations.add(database, gone.id, {"run_keys": [mine.key, shared.key]}, {}, "adopt")
    confirmations.add(database, kept.id, {"run_keys": [shared.key]}, {}, "adopt")

    studies.delete_study(database, "gone")

    assert list(runs.find(database, [mine.key, shared.key])) == [shared.key]


def test_side_metrics_are_replaced_and_listed_by_number(database: Database, study: Study) -> None:
    trial_id = run_trial(database, study, 0.5)
    ground_truth_errors.save(database, trial_id, [Validation("desk", 0.2), Validation("room", 0.3)])
    ground_truth_errors.save(database, trial_id, [Validation("desk", float("nan"), {"reason": "no overlap"})])
    assert ground_truth_errors.of_study(database, study.id) == {0: [Validation("desk", None, {"reason": "no overlap"})]}


def test_confirmations_are_listed_oldest_first(database: Database, study: Study) -> None:
    added = [confirmations.add(database, study.id, {"k": k}, {"p": 0.01}, "improves") for k in (1, 2)]
    assert confirmations.of_study(database, study.id) == added
