"""The user's baseline is what nominal means: trial 0, coverage floor, every improvement."""

from pathlib import Path
from typing import Any

import pytest

from gtf_tune.definition import definition_from_dict
from gtf_tune.display import nominal_text
from gtf_tune.errors import DefinitionError
from gtf_tune.pipelines import create_pipeline
from gtf_tune.store import runs, studies, trials
from gtf_tune.store.database import Database
from gtf_tune.store.optuna.tables import optuna_storage
from gtf_tune.study.create import checked_definition
from gtf_tune.study.outcome.export import options_text
from gtf_tune.study.outcome.improvement import read_improvements
from gtf_tune.study.search.space import SearchSpace, build_space
from tests.study.conftest import Runner, definition_of

TABLE = create_pipeline("analytic").options
MINE = 0.004


def _data(room: Path, nominal: dict[str, Any], **sections: Any) -> dict[str, Any]:
    return definition_of(room, pipeline={"nominal": nominal}, **sections)


def _space(room: Path, nominal: dict[str, Any], **sections: Any) -> SearchSpace:
    return build_space(definition_from_dict(_data(room, nominal, **sections)), TABLE)


def test_trial_zero_has_the_users_values_and_improvements_are_against_it(
    room: Path, database: Database, run_study: Runner
) -> None:
    run_study(_data(room, {"filter.max_error": MINE}))

    study = studies.get(database, "small")
    nominal, *others = trials.of_study(database, study.id)
    shown = optuna_storage(database).get_all_trials(study.optuna_study_id)
    improvements = {one.number: one.user_attrs["improvement_percent"] for one in shown if one.number}
    assert nominal.options == {"filter.max_error": MINE}
    paired = read_improvements(database, study.id, others)
    assert improvements == {number: pytest.approx(100 * one.value, abs=0.01) for number, one in paired.items()}
    assert len(improvements) == 7


def test_the_coverage_floor_is_that_of_the_users_values(room: Path, database: Database, run_study: Runner) -> None:
    strict = {"filter.max_error": {"values": [2e-4, 0.01]}}  # at 2e-4 frames are lost
    grid = {"space": strict, "search": {"sampler": "grid"}}
    run_study(definition_of(room, **grid))
    run_study({**_data(room, {"filter.max_error": 2e-4}, **grid), "name": "lossy"})

    by_default, mine = (trials.of_study(database, studies.get(database, name).id) for name in ("small", "lossy"))

    assert [(one.options, one.feasible) for one in by_default] == [
        ({"filter.max_error": 0.01}, True),
        ({"filter.max_error": 2e-4}, False),
    ]
    assert [(one.options, one.feasible) for one in mine] == [
        ({"filter.max_error": 2e-4}, True),
        ({"filter.max_error": 0.01}, True),
    ]


def test_an_unsearched_option_has_the_users_value_in_every_run(
    room: Path, database: Database, run_study: Runner
) -> None:
    run_study(_data(room, {"robust.kernel": "cauchy", "filter.max_error": MINE}, search={"trials": 3}))

    found = runs.of_study(database, studies.get(database, "small").id)
    assert {one.run.options["robust.kernel"] for one in found} == {"cauchy"}
    assert {one.run.options["filter.max_error"] for one in found if one.number == 0} == {MINE}


def test_values_that_equal_the_defaults_change_no_run(room: Path, run_study: Runner) -> None:
    run_study(definition_of(room, search={"trials": 3}))

    again = run_study({**_data(room, {"filter.max_error": 0.01, "robust.scale": 1}, search={"trials": 3}), "name": "a"})

    assert again.executed == []


def test_the_noise_is_measured_under_the_users_values(room: Path, database: Database, run_study: Runner) -> None:
    few = {"clean_runs": 1, "noisy_runs": 2, "noise_sigma": "auto"}
    executor = run_study(
        _data(room, {"filter.max_error": MINE, "robust.kernel": "cauchy"}, gtf=few, search={"trials": 1})
    )

    made = executor.executed
    assert len({run.noise_sigma for run in made}) > 2
    assert {(run.options["filter.max_error"], run.options["robust.kernel"]) for run in made} == {(MINE, "cauchy")}


def test_a_grid_takes_the_users_value_in_and_tries_it_once(room: Path) -> None:
    grid = {"space": {"filter.max_error": {"values": [0.01, 0.02]}}, "search": {"sampler": "grid"}}

    outside = _space(room, {"filter.max_error": MINE}, **grid)
    inside = _space(room, {"filter.max_error": 0.02}, **grid)

    assert (outside.grid_size(), inside.grid_size()) == (3, 2)
    assert list(inside.grid()) == [{"filter.max_error": 0.01}]


def test_a_list_of_words_takes_the_users_word_in(room: Path) -> None:
    words = {"space": {"robust.kernel": {"values": ["huber", "cauchy"]}}}

    space = _space(room, {"robust.kernel": "trivial"}, **words)

    assert space.nominal == {"robust.kernel": "trivial"}
    assert space.distributions["robust.kernel"].choices == ("trivial", "huber", "cauchy")  # type: ignore[attr-defined]


def test_values_are_brought_to_the_type_of_the_option(room: Path) -> None:
    space = _space(room, {"robust.scale": 2}, space={"robust.scale": {"low": 0.1, "high": 10}})

    assert repr(space.nominal["robust.scale"]) == "2.0"


@pytest.mark.parametrize(
    ("nominal", "reason"),
    [
        ({"filter.max_error": 0.5}, r"\[0.0003, 0.1\] leaves out the nominal value 0.5, which trial 0 measures"),
        ({"filter.max_eror": 0.5}, "unknown option 'filter.max_eror'.*did you mean 'filter.max_error'"),
        ({"robust.kernel": "hube"}, "option 'robust.kernel' takes one of trivial, huber, cauchy, not 'hube'"),
        ({"robust": {"kernel": "huber"}}, r"write the name in quotes: \"robust.kernel\""),
    ],
)
def test_values_that_do_not_suit_are_refused(room: Path, nominal: dict[str, Any], reason: str) -> None:
    with pytest.raises(DefinitionError, match=reason):
        checked_definition(_data(room, nominal), "test")


def test_a_range_needs_the_users_value_and_not_the_default(room: Path) -> None:
    without_default = {"filter.max_error": {"low": 1e-3, "high": 5e-3}}

    assert _space(room, {"filter.max_error": MINE}, space=without_default).nominal == {"filter.max_error": MINE}


def test_an_option_cannot_be_fixed_at_another_value_than_the_users(room: Path) -> None:
    data = _data(room, {"robust.scale": 2.0})
    data["pipeline"]["options"] = {"robust.scale": 3.0}

    with pytest.raises(DefinitionError, match=r"held fixed at other values than their nominal ones: robust\.scale"):
        definition_from_dict(data)


def test_what_is_exported_holds_the_users_values(room: Path) -> None:
    definition = definition_from_dict(_data(room, {"robust.kernel": "cauchy", "filter.max_error": MINE}))

    text = options_text("json", definition, {"filter.max_error": 0.02})

    assert '"kernel": "cauchy"' in text
    assert '"max_error": 0.02' in text


def test_words_say_whose_values_nominal_are(room: Path) -> None:
    mine = definition_from_dict(_data(room, {"robust.kernel": "cauchy", "filter.max_error": MINE}))

    assert nominal_text(definition_from_dict(definition_of(room))) == "the program's defaults"
    assert nominal_text(mine) == "yours: robust.kernel=cauchy, filter.max_error=0.004"
