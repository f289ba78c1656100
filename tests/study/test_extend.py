from pathlib import Path

import pytest

from gtf_tune.errors import DefinitionError, OptionError, StorageError
from gtf_tune.store import runs, studies, trials
from gtf_tune.store.database import Database
from gtf_tune.study.create import checked_definition, create_study
from gtf_tune.study.edit import Extension, derive_study, extend_study
from gtf_tune.study.open_study import open_study
from tests.study.conftest import Runner, definition_of

AXIS = {"filter.max_error": {"low": 1e-4, "high": 1.0, "log": True}}


def _options(database: Database, name: str = "small") -> list[object]:
    return [trial.options for trial in trials.of_study(database, studies.get(database, name).id)]


def test_more_trials_go_on_where_the_study_stood(room: Path, database: Database, run_study: Runner) -> None:
    run_study(definition_of(room, search={"trials": 3}))
    before = _options(database)

    extended = extend_study(database, "small", Extension(trials=5))
    executor = run_study(definition_of(room))

    assert extended.state == "open"
    assert _options(database)[:3] == before
    assert len(_options(database)) == 5
    assert len(executor.executed) == 2 * 5


def test_an_extension_leaves_a_trace(room: Path, database: Database, run_study: Runner) -> None:
    run_study(definition_of(room, search={"trials": 3}))

    extended = extend_study(database, "small", Extension(trials=4))

    (change,) = extended.resolved["extensions"]
    assert change["before"]["search"]["trials"] == 3


def test_fewer_trials_than_there_are_is_refused(room: Path, database: Database, run_study: Runner) -> None:
    run_study(definition_of(room, search={"trials": 3}))

    with pytest.raises(DefinitionError, match="has 3 trials already"):
        extend_study(database, "small", Extension(trials=2))


def test_the_new_total_is_never_smaller_even_where_nothing_has_run(room: Path, database: Database) -> None:
    create_study(database, checked_definition(definition_of(room, search={"trials": 10}), "test"), room.parent)

    with pytest.raises(DefinitionError, match="has 10 trials already, more than 5, which would be the new total"):
        extend_study(database, "small", Extension(trials=5))


def test_a_range_may_be_widened(room: Path, database: Database, run_study: Runner) -> None:
    run_study(definition_of(room, search={"trials": 3}))

    extend_study(database, "small", Extension(trials=5, axes=AXIS))
    run_study(definition_of(room))

    assert len(_options(database)) == 5


@pytest.mark.parametrize("sampler", ["qmc", "optuna.samplers:NSGAIISampler"])
def test_a_range_is_not_widened_where_the_sampler_would_stay_in_the_old_one(
    room: Path, database: Database, run_study: Runner, sampler: str
) -> None:
    run_study(definition_of(room, search={"trials": 3, "sampler": sampler}))

    with pytest.raises(DefinitionError, match=f"sampler '{sampler}' would lose its place"):
        extend_study(database, "small", Extension(trials=5, axes=AXIS))


@pytest.mark.parametrize(
    ("option", "axis", "reason"),
    [
        ("filter.max_error", {"low": 1e-3, "high": 0.1, "log": True}, "trials may lie outside"),
        ("filter.max_error", {"low": 1e-4, "high": 1.0, "log": False}, "scale or step"),
        ("robust.scale", {"low": 0.1, "high": 10.0, "log": True}, "were not searched along it"),
    ],
)
def test_a_range_that_finished_trials_do_not_fit_is_refused(
    room: Path, database: Database, run_study: Runner, option: str, axis: dict[str, object], reason: str
) -> None:
    run_study(definition_of(room, search={"trials": 2}))

    with pytest.raises(DefinitionError, match=rf"{reason}.*derive a new study by the same changes"):
        extend_study(database, "small", Extension(axes={option: axis}))


def test_another_number_of_noisy_runs_is_refused_with_the_way_out(
    room: Path, database: Database, run_study: Runner
) -> None:
    run_study(definition_of(room, search={"trials": 2}))

    with pytest.raises(DefinitionError, match=r"scored by 3 noisy runs each.*derive a new study"):
        extend_study(database, "small", Extension(noisy_runs=6))


def test_a_derived_study_reuses_the_runs_that_are_the_same(room: Path, database: Database, run_study: Runner) -> None:
    grid = {"space": {"filter.max_error": {"values": [0.01, 0.002]}}, "search": {"sampler": "grid"}}
    run_study(definition_of(room, **grid))

    derived = derive_study(database, "small", Extension(noisy_runs=5), "more")
    executor = run_study({**definition_of(room, **grid), "name": "more"})

    assert _options(database, "more") == _options(database)
    assert len(executor.executed) == 2 * 2
    assert runs.totals(database, derived.id).reused == 2 * (2 + 3)


def test_an_unfinished_copy_is_neither_extended_nor_opened(room: Path, database: Database, run_study: Runner) -> None:
    run_study(definition_of(room, search={"trials": 2}))
    study_id = studies.get(database, "small").id
    studies.set_state(database, study_id, "copying")

    for use in (lambda: extend_study(database, "small", Extension(trials=4)), lambda: open_study(database, "small")):
        with pytest.raises(StorageError, match="unfinished copy"):
            use()
    assert studies.get(database, "small").state == "copying"


def test_nothing_to_extend_by_is_an_error(room: Path, database: Database, run_study: Runner) -> None:
    run_study(definition_of(room, search={"trials": 2}))

    with pytest.raises(
        DefinitionError, match="nothing to extend study 'small' by; give more trials or a wider range, or"
    ):
        extend_study(database, "small", Extension())


def test_a_range_of_an_option_that_does_not_exist_is_answered_with_the_nearest_name(
    room: Path, database: Database, run_study: Runner
) -> None:
    run_study(definition_of(room, search={"trials": 2}))

    with pytest.raises(OptionError, match=r"unknown option 'filter.max_eror'.*did you mean 'filter.max_error'\?"):
        extend_study(database, "small", Extension(axes={"filter.max_eror": AXIS["filter.max_error"]}))
