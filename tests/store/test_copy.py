from collections.abc import Callable, Iterator

import optuna
import pytest
from optuna.trial import TrialState, create_trial
from optuna_dashboard import get_note, save_note
from sqlalchemy import text

from gtf_tune.errors import StorageError
from gtf_tune.pipelines.run import RunOutcome, RunRequest
from gtf_tune.store import confirmations, ground_truth_errors, runs, studies, trial_queue, trials
from gtf_tune.store.database import Database, open_database
from gtf_tune.store.ground_truth_errors import Validation
from gtf_tune.store.maintenance import copy
from gtf_tune.store.maintenance.copy import copy_study
from gtf_tune.store.maintenance.digest import study_digest
from gtf_tune.store.optuna.rows import NUMBER_KEY
from gtf_tune.store.optuna.tables import optuna_storage
from gtf_tune.store.runs import TrialRun, trajectories
from gtf_tune.store.studies import Study
from gtf_tune.store.trial_queue import TrialResult, this_worker

MakeStorage = Callable[[str, bool], str]
TO_POSTGRESQL, TO_SQLITE = ("sqlite", "postgresql"), ("postgresql", "sqlite")
both_ways = pytest.mark.parametrize("pair", [TO_POSTGRESQL, TO_SQLITE], indirect=True, ids=["to-pg", "to-sqlite"])


@pytest.fixture
def pair(request: pytest.FixtureRequest, make_storage: MakeStorage) -> Iterator[tuple[Database, Database]]:
    """Yield a source and a target, both on SQLite unless the test says otherwise."""
    backends = getattr(request, "param", ("sqlite", "sqlite"))
    opened = tuple(open_database(make_storage(backend, True)) for backend in backends)
    yield opened
    for database in opened:
        database.close()


@pytest.fixture
def fill(
    make_study: Callable[..., Study], make_request: Callable[..., RunRequest], make_outcome: Callable[..., RunOutcome]
) -> Callable[[Database], Study]:
    """Return a function that fills a database with one study in which everything occurs."""

    def make(database: Database) -> Study:
        study = make_study(database)
        for number in range(3):
            lease = trial_queue.lease_trial(database, study.id, 9, this_worker())
            frozen = _optuna_trial(database, study, number)
            trial_queue.attach_optuna_trial(database, lease, frozen._trial_id, frozen.number, {"a.b": 0.1 * number})
            saved = runs.save(database, make_request("noisy", number), make_outcome(number))
            runs.link(database, lease.trial_id, [TrialRun(0, "desk", saved, reused=number > 1)])
            ground_truth_errors.save(database, lease.trial_id, [Validation("desk", 0.1 / 3)])
            if number < 2:
                trial_queue.finish(
                    database, lease, TrialResult("complete", value=0.1, feasible=True, detail={"m": [0.1]})
                )
        confirmations.add(database, study.id, {"k": 1}, {"p": 0.5}, "keeps")
        return study

    return make


def _optuna_trial(database: Database, study: Study, number: int) -> optuna.trial.FrozenTrial:
    loaded = optuna.load_study(study_name=study.name, storage=optuna_storage(database))
    loaded.add_trial(
        create_trial(
            state=TrialState.COMPLETE if number < 2 else TrialState.RUNNING,
            value=0.1 / 3 if number < 2 else None,
            params={"x": 0.1, "mode": "b"},
            distributions={
                "x": optuna.distributions.FloatDistribution(1e-3, 1, log=True),
                "mode": optuna.distributions.CategoricalDistribution(["a", "b", None]),
            },
            user_attrs={"coverage": 1.0},
            system_attrs={"constraints": [-0.1], NUMBER_KEY: number},
            intermediate_values={0: float("inf"), 1: 0.25},
        )
    )
    return optuna_storage(database).get_all_trials(study.optuna_study_id)[number]


@both_ways
def test_a_copy_holds_everything(pair: tuple[Database, Database], fill: Callable[[Database], Study]) -> None:
    source, target = pair
    study = fill(source)

    digest = copy_study(source, target, "room")

    copied = studies.get(target, "room")
    assert digest == study_digest(source, "room") == study_digest(target, "room")
    assert (copied.state, copied.definition, copied.created_at) == (study.state, study.definition, study.created_at)
    assert studies.sequences(target, copied.id) == studies.sequences(source, study.id)
    assert confirmations.of_study(target, copied.id) == confirmations.of_study(source, study.id)
    old, new = runs.of_study(source, study.id), runs.of_study(target, copied.id)
    assert [(one.reused, one.run.key, one.run.diagnostics) for one in old] == [
        (one.reused, one.run.key, one.run.diagnostics) for one in new
    ]
    assert len(trajectories(target, [one.run.key for one in new])) == 3
    best = trials.best(target, copied.id)
    assert best is not None
    assert trials.details(target, [best.id]) == {best.id: {"m": [0.1]}}


@both_ways
def test_a_copy_can_be_copied_back(pair: tuple[Database, Database], fill: Callable[[Database], Study]) -> None:
    source, target = pair
    digest, optuna_digest = study_digest(source, fill(source).name), copy.optuna_digest(source, 1)
    copy_study(source, target, "room")
    studies.delete_study(source, "room")
    assert copy_study(target, source, "room") == digest
    assert copy.optuna_digest(source, studies.get(source, "room").optuna_study_id) == optuna_digest


def test_a_leased_trial_is_free_in_the_copy(pair: tuple[Database, Database], fill: Callable[[Database], Study]) -> None:
    source, target = pair
    fill(source)
    copy_study(source, target, "room")
    adopted = trial_queue.adopt_stale(target, studies.get(target, "room").id, this_worker(), grace_s=1e9)
    assert adopted is not None
    assert adopted.number == 2
    assert optuna_storage(target).get_trial(adopted.optuna_trial_id).state == TrialState.RUNNING


@both_ways
def test_notes_of_the_dashboard_follow_their_trials(
    pair: tuple[Database, Database], fill: Callable[[Database], Study], make_study: Callable[..., Study]
) -> None:
    source, target = pair
    fill(source)
    other = make_study(target, "other")
    optuna_storage(target).create_new_trial(other.optuna_study_id)
    loaded = optuna.load_study(study_name="room", storage=optuna_storage(source))
    save_note(loaded, "about the study")
    for trial in loaded.trials:
        save_note(optuna.trial.Trial(loaded, trial._trial_id), f"about trial {trial.number}")

    copy_study(source, target, "room")

    copied = optuna.load_study(study_name="room", storage=optuna_storage(target))
    notes = [get_note(optuna.trial.Trial(copied, trial._trial_id)) for trial in copied.trials]
    assert get_note(copied) == "about the study"
    assert notes == ["about trial 0", "about trial 1", "about trial 2"]


def test_runs_that_the_target_has_are_not_copied_again(
    pair: tuple[Database, Database],
    fill: Callable[[Database], Study],
    make_request: Callable[..., RunRequest],
    make_outcome: Callable[..., RunOutcome],
) -> None:
    source, target = pair
    fill(source)
    known = runs.save(target, make_request("noisy", 1), make_outcome(1))
    copy_study(source, target, "room")
    linked = runs.of_study(target, studies.get(target, "room").id)
    assert known in [one.run for one in linked]


def test_a_copy_that_differs_leaves_nothing_behind(
    pair: tuple[Database, Database],
    fill: Callable[[Database], Study],
    make_request: Callable[..., RunRequest],
    make_outcome: Callable[..., RunOutcome],
) -> None:
    source, target = pair
    fill(source)
    runs.save(target, make_request("noisy", 1), make_outcome(99))
    with pytest.raises(StorageError, match="changed while it was copied"):
        copy_study(source, target, "room")
    assert studies.names(target) == []
    assert optuna_storage(target).get_all_studies() == []


def test_a_study_of_the_same_name_is_never_overwritten(
    pair: tuple[Database, Database], fill: Callable[[Database], Study], make_study: Callable[..., Study]
) -> None:
    source, target = pair
    fill(source)
    kept = make_study(target, "room")
    with pytest.raises(StorageError, match="already holds a study 'room'"):
        copy_study(source, target, "room")
    assert studies.get(target, "room") == kept


@pytest.mark.parametrize("last_step", ["create_optuna_study", "copy_optuna_study", "_copy_runs", "_copy_trials"])
def test_a_copy_that_was_killed_between_its_steps_is_made_anew(
    last_step: str,
    pair: tuple[Database, Database],
    fill: Callable[[Database], Study],
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    source, target = pair
    fill(source)

    def killed(*arguments: object) -> object:
        step(*arguments)
        raise KeyboardInterrupt  # as SIGKILL, which lets nothing be undone either

    with monkeypatch.context() as patched:
        step = getattr(copy, last_step)
        patched.setattr(copy, last_step, killed)
        patched.setattr(copy, "_undo", lambda *_: None)
        with pytest.raises(KeyboardInterrupt):
            copy_study(source, target, "room")

    assert copy_study(source, target, "room") == study_digest(source, "room")
    assert studies.get(target, "room").state == "open"
    assert len(optuna_storage(target).get_all_studies()) == 1


def test_an_optuna_study_of_the_same_name_is_never_overwritten(
    pair: tuple[Database, Database], fill: Callable[[Database], Study]
) -> None:
    source, target = pair
    fill(source)
    optuna.create_study(study_name="room", storage=optuna_storage(target)).ask()
    with pytest.raises(StorageError, match="has an Optuna study 'room' with trials that gtf-tune did not make"):
        copy_study(source, target, "room")


def test_a_damaged_trajectory_is_not_copied(pair: tuple[Database, Database], fill: Callable[[Database], Study]) -> None:
    source, target = pair
    fill(source)
    with source.engine.begin() as connection:
        connection.execute(text("UPDATE gtf_run_output SET trajectory = :none"), {"none": b"none"})
    with pytest.raises(StorageError, match="is damaged"):
        copy_study(source, target, "room")
    assert studies.names(target) == []
    with target.engine.connect() as connection:
        assert connection.scalar(text("SELECT count(*) FROM gtf_run")) == 0


def test_runs_of_confirmations_are_copied(
    pair: tuple[Database, Database],
    fill: Callable[[Database], Study],
    make_request: Callable[..., RunRequest],
    make_outcome: Callable[..., RunOutcome],
) -> None:
    source, target = pair
    study = fill(source)
    confirmed = runs.save(source, make_request("noisy", 77), make_outcome(77))
    confirmations.add(source, study.id, {"run_keys": [confirmed.key]}, {"p": 0.5}, "keeps")

    copy_study(source, target, "room")

    assert runs.find(target, [confirmed.key])[confirmed.key].num_poses == confirmed.num_poses
    assert list(trajectories(target, [confirmed.key])) == [confirmed.key]


def test_a_storage_is_not_copied_to_itself(pair: tuple[Database, Database], fill: Callable[[Database], Study]) -> None:
    source, _ = pair
    fill(source)
    with pytest.raises(StorageError, match=r"^both storages are sqlite:.*; give another one to copy to$"):
        copy_study(source, open_database(str(source.url.database)), "room")


@pytest.mark.parametrize(
    "change",
    [
        "UPDATE gtf_trial SET value = 0.2 WHERE ordinal = 1",
        "UPDATE gtf_trial SET options = '{}' WHERE ordinal = 1",
        "UPDATE gtf_trial SET state = 'failed' WHERE ordinal = 1",
        "UPDATE gtf_run SET trajectory_digest = 'other' WHERE index_ = 1",
        "UPDATE gtf_validation SET ate = 0.2",
        "UPDATE gtf_sequence SET fingerprint = 'other'",
    ],
)
def test_the_digest_notices_every_result(
    make_storage: MakeStorage, fill: Callable[[Database], Study], change: str
) -> None:
    database = open_database(make_storage("sqlite", True))
    fill(database)
    before = study_digest(database, "room")
    with database.engine.begin() as connection:
        connection.execute(text(change))
    after = study_digest(database, "room")
    database.close()
    assert after != before
