"""Trials with options that somebody names, beside those of the search."""

import re
from pathlib import Path
from typing import Any

import optuna
import pytest
from optuna.trial import TrialState

from gtf_tune.errors import DefinitionError, OptionError
from gtf_tune.execution import InlineExecutor
from gtf_tune.store import enqueued, studies, trials
from gtf_tune.store.database import Database, create_database
from gtf_tune.store.maintenance.check import check
from gtf_tune.store.maintenance.digest import study_digest
from gtf_tune.store.optuna.tables import optuna_storage
from gtf_tune.study.create import checked_definition, create_study
from gtf_tune.study.edit import Extension, extend_study
from gtf_tune.study.enqueue import enqueue
from gtf_tune.study.events import Event, TrialFinished
from gtf_tune.study.open_study import open_study, trials_left
from gtf_tune.study.runs.stop import FINISH_RUNS, StopRequest
from gtf_tune.study.work.worker import StudyWorker
from tests.study.conftest import Runner, definition_of

THEIRS = {"filter.max_error": 0.004}
LIST = {"filter.max_error": {"values": [0.001, 0.01, 0.1]}}
TWO = {
    "filter.max_error": {"low": 3e-4, "high": 0.1, "log": True, "points": 3},
    "robust.scale": {"low": 0.01, "high": 10.0, "log": True, "points": 3},
}


def _trials(database: Database, name: str = "small") -> list[trials.Trial]:
    return trials.of_study(database, studies.get(database, name).id)


def _options(database: Database, name: str = "small") -> list[Any]:
    return [one.options for one in _trials(database, name)]


def _optuna(database: Database) -> optuna.Study:
    return optuna.load_study(study_name="small", storage=optuna_storage(database))


def _run_some(run_study: Runner, data: dict[str, Any], count: int) -> None:
    """Work on a study until so many more of its trials have ended."""
    stop, ended = StopRequest(), []

    def note(event: Event) -> None:
        if isinstance(event, TrialFinished):
            ended.append(event)
            if len(ended) == count:
                stop.ask(FINISH_RUNS)

    run_study(data, stop=stop, callbacks=[note])


def test_a_study_remembers_which_of_its_first_trials_the_preset_names_as_leading(
    room: Path, database: Database
) -> None:
    huber = "mapper.bundle_adjustment.ceres.loss_function_scale"
    first = [{huber: 0.2}, {huber: 0.05}]
    data = definition_of(
        room,
        pipeline={"name": "glomap", "settings": {}, "options": {}},
        space={huber: {"low": 0.01, "high": 1.0, "log": True}},
        search={"first": first},
    )

    study = create_study(database, checked_definition(data, "test"), room.parent)

    number = study.resolved["lead"]["number"]
    assert trials.get(database, study.id, number).options == {huber: 0.05}
    assert 0 < study.resolved["lead"]["margin"] < 1


def test_an_enqueued_trial_comes_next_and_the_budget_rises_by_one(
    room: Path, database: Database, run_study: Runner
) -> None:
    _run_some(run_study, definition_of(room), 3)

    number = enqueue(database, "small", THEIRS)
    run_study(definition_of(room))

    assert number == 3
    assert _options(database)[3] == THEIRS
    assert len(_options(database)) == 9
    assert studies.get(database, "small").state == "done"
    assert check(database).problems == ()


@pytest.mark.parametrize("sampler", ["grid", "qmc", "random", "refine", "optuna.samplers:QMCSampler"])
def test_the_search_tries_what_it_would_have_tried_anyway(
    room: Path, database: Database, run_study: Runner, sampler: str
) -> None:
    data = definition_of(room, space=TWO, gtf={"noisy_runs": 2}, search={"sampler": sampler, "trials": 4})
    run_study({**data, "name": "undisturbed"})
    _run_some(run_study, data, 2)

    enqueue(database, "small", THEIRS)
    run_study(data)

    expected = _options(database, "undisturbed")
    found = _options(database)
    assert found[2] == {"filter.max_error": 0.004, "robust.scale": 1.0}
    assert found[:2] + found[3:] == expected


def test_a_grid_tries_every_point_whenever_trials_are_enqueued(
    room: Path, database: Database, run_study: Runner
) -> None:
    data = definition_of(room, space=LIST, search={"sampler": "grid", "trials": None})
    create_study(database, checked_definition(data, "test"), room)

    enqueue(database, "small", THEIRS)
    _run_some(run_study, data, 3)
    enqueue(database, "small", {"filter.max_error": 0.02})
    run_study(data)

    assert [one["filter.max_error"] for one in _options(database)] == [0.01, 0.004, 0.001, 0.02, 0.1]
    assert studies.get(database, "small").state == "done"


def test_nominal_comes_first_even_where_a_trial_was_enqueued_before_the_study_ran(
    room: Path, database: Database, run_study: Runner
) -> None:
    create_study(database, checked_definition(definition_of(room), "test"), room)

    enqueue(database, "small", THEIRS)
    assert check(database).problems == ()
    run_study(definition_of(room))

    first, second, *_ = _trials(database)
    assert (first.options, second.options) == ({"filter.max_error": 0.01}, THEIRS)
    assert first.finished_at is not None
    assert second.started_at >= first.finished_at


def test_a_study_that_was_done_goes_on(room: Path, database: Database, run_study: Runner) -> None:
    run_study(definition_of(room, search={"trials": 3}))

    enqueue(database, "small", THEIRS)
    left = trials_left(database, studies.get(database, "small"))
    run_study(definition_of(room))

    assert left == 1
    assert _options(database)[3:] == [THEIRS]


def test_a_study_that_is_paused_stays_so(room: Path, database: Database, run_study: Runner) -> None:
    _run_some(run_study, definition_of(room), 2)
    studies.set_state(database, studies.get(database, "small").id, "paused")

    enqueue(database, "small", THEIRS)

    assert studies.get(database, "small").state == "paused"


def test_an_interrupted_study_with_enqueued_trials_goes_on_as_if_it_had_never_stopped(
    room: Path, tmp_path: Path, database: Database, run_study: Runner
) -> None:
    undisturbed = create_database(str(tmp_path / "undisturbed.db"))
    for one in (undisturbed, database):
        create_study(one, checked_definition(definition_of(room), "test"), tmp_path)
        enqueue(one, "small", THEIRS)
    StudyWorker(open_study(undisturbed, "small"), InlineExecutor()).work()

    for _ in range(5):
        _run_some(run_study, definition_of(room), 2)

    assert study_digest(database, "small") == study_digest(undisturbed, "small")


def test_trials_are_the_total_when_a_study_is_extended(room: Path, database: Database, run_study: Runner) -> None:
    run_study(definition_of(room, search={"trials": 3}))
    enqueue(database, "small", THEIRS)

    with pytest.raises(DefinitionError, match="has 4 trials already, more than 3"):
        extend_study(database, "small", Extension(trials=3))
    extend_study(database, "small", Extension(trials=6))
    run_study(definition_of(room))

    assert len(_options(database)) == 6
    assert open_study(database, "small").budget == 6


def test_a_worker_that_is_at_it_takes_the_trial_up(room: Path, database: Database, run_study: Runner) -> None:
    def colleague(event: Event) -> None:
        if isinstance(event, TrialFinished) and event.number == 1:
            enqueue(database, "small", THEIRS)
            _optuna(database).enqueue_trial({"filter.max_error": 0.005})

    run_study(definition_of(room, search={"trials": 4}), callbacks=[colleague])

    found = _options(database)
    assert {str(THEIRS), str({"filter.max_error": 0.005})} == {str(one) for one in found[2:4]}
    assert len(found) == 6


def test_trials_of_optunas_own_queue_are_adopted(room: Path, database: Database, run_study: Runner) -> None:
    data = definition_of(room, space=TWO, gtf={"noisy_runs": 2}, search={"sampler": "random", "trials": 4})
    run_study({**data, "name": "undisturbed"})
    _run_some(run_study, data, 2)

    _optuna(database).enqueue_trial({"filter.max_error": 0.004, "robust.scale": 2}, user_attrs={"memo": "Ann's"})
    _optuna(database).enqueue_trial({"filter.max_error": 0.003})
    run_study(data)

    found, theirs = _options(database), _optuna(database).get_trials()
    assert found[2] == {"filter.max_error": 0.004, "robust.scale": 2.0}
    assert found[3]["filter.max_error"] == 0.003
    assert found[:2] + found[4:] == _options(database, "undisturbed")
    assert [one.state for one in theirs] == [TrialState.COMPLETE] * 6
    assert [one.user_attrs["memo"] for one in theirs if "memo" in one.user_attrs] == ["Ann's"]
    assert check(database).problems == ()


@pytest.mark.parametrize(
    ("options", "reason"),
    [
        ({"filter.max_eror": 1.0}, "unknown option 'filter.max_eror'"),
        ({"filter.max_error": 0.5}, r"is searched over \[0.0003, 0.1\], not 0.5"),
        ({"filter.max_error": "wide"}, "takes a number"),
    ],
)
def test_what_a_study_cannot_have_fails_in_optunas_queue_with_the_reason(
    room: Path, database: Database, run_study: Runner, options: dict[str, Any], reason: str
) -> None:
    _run_some(run_study, definition_of(room, search={"trials": 3}), 2)

    _optuna(database).enqueue_trial(options)
    run_study(definition_of(room))

    (refused,) = [one for one in _optuna(database).get_trials() if one.state == TrialState.FAIL]
    assert len(_options(database)) == 3
    assert re.search(reason, refused.user_attrs["refused"])


def test_a_trial_of_optunas_queue_is_adopted_once(room: Path, database: Database, run_study: Runner) -> None:
    _run_some(run_study, definition_of(room), 2)
    _optuna(database).enqueue_trial(THEIRS)
    study = studies.get(database, "small")
    (waiting,) = enqueued.waiting_in_optuna(database, study)

    for _ in range(2):
        enqueued.adopt(database, study.id, waiting)

    assert enqueued.waiting_in_optuna(database, study) == []
    assert enqueued.enqueued_numbers(database, study.id) == (2,)


@pytest.mark.parametrize(
    ("options", "reason"),
    [
        ({"filter.max_eror": 1.0}, "unknown option 'filter.max_eror'.*did you mean 'filter.max_error'"),
        ({"filter.max_error": 0.5}, r"is searched over \[0.0003, 0.1\], not 0.5; widen that"),
        ({"filter.max_error": "wide"}, "takes a number, not 'wide'"),
        ({"robust.kernel": "trivial"}, "is searched over huber, cauchy, not 'trivial'"),
        ({"robust.scale": 2.0}, "option 'robust.scale' is not searched but 3.0 in every trial, not 2.0"),
        ({"tracks.min_length": 5}, "option 'tracks.min_length' is not searched but 3 in every trial, not 5"),
    ],
)
def test_options_that_a_study_cannot_have_are_refused(
    room: Path, database: Database, options: dict[str, Any], reason: str
) -> None:
    data = definition_of(room, pipeline={"options": {"robust.scale": 3.0}})
    data["space"]["robust.kernel"] = {"values": ["huber", "cauchy"]}
    create_study(database, checked_definition(data, "test"), room)

    with pytest.raises(OptionError, match=reason):
        enqueue(database, "small", options)

    assert _trials(database) == []


def test_options_that_every_trial_has_anyway_may_be_named(room: Path, database: Database) -> None:
    data = definition_of(room, pipeline={"options": {"robust.scale": 3.0}})
    create_study(database, checked_definition(data, "test"), room)

    enqueue(database, "small", {"robust.scale": 3, "tracks.min_length": 3, **THEIRS})

    assert _options(database) == [None, THEIRS]
