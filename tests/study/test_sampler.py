from pathlib import Path
from typing import Any

import optuna
import pytest
from optuna.distributions import CategoricalDistribution, FloatDistribution
from optuna.samplers import RandomSampler, TPESampler

from gtf_tune.definition import SearchDefinition, StudyDefinition, definition_from_dict
from gtf_tune.errors import DefinitionError
from gtf_tune.store.database import create_database
from gtf_tune.store.optuna.foreign_sampler import ForeignSampler
from gtf_tune.study.create import create_study
from gtf_tune.study.search.qmc import NumberedPointsSampler
from gtf_tune.study.search.refine import RefineSampler
from gtf_tune.study.search.refine_many import RefineManySampler
from gtf_tune.study.search.samplers import make_sampler, startup_trials
from gtf_tune.study.search.space import SearchAxis, SearchSpace
from tests.study.conftest import definition_of

RANGE = {"low": 3e-4, "high": 0.1, "log": True}
LIST = {"values": [0.01, 0.02]}
ONE_RANGE = SearchSpace((SearchAxis("x", 0.5, FloatDistribution(0.0, 1.0), ()),))


def _definition(**sections: Any) -> StudyDefinition:
    return definition_from_dict(definition_of(Path("room"), **sections))


@pytest.mark.parametrize(
    ("name", "kind"),
    [
        ("tpe", TPESampler),
        ("refine", RefineSampler),
        ("qmc", NumberedPointsSampler),
        ("random", RandomSampler),
        ("grid", RandomSampler),
        ("optuna.samplers:NSGAIISampler", ForeignSampler),
    ],
)
def test_every_name_makes_its_sampler(name: Any, kind: type) -> None:
    assert isinstance(make_sampler(SearchDefinition(sampler=name), 3, ONE_RANGE), kind)


def test_refine_searches_several_options_and_lists_by_a_surface() -> None:
    kernel = SearchAxis("k", "huber", CategoricalDistribution(("huber", "cauchy")), ())

    for space in (SearchSpace((*ONE_RANGE.axes, kernel)), SearchSpace((kernel,))):
        assert isinstance(make_sampler(SearchDefinition(sampler="refine"), 3, space), RefineManySampler)


def test_start_up_points_differ_between_trials_and_repeat_after_a_resume() -> None:
    def first_value(number: int) -> float:
        study = optuna.create_study(sampler=make_sampler(SearchDefinition(sampler="tpe", seed=4), number, ONE_RANGE))
        return study.ask().suggest_float("x", 0.0, 1.0)

    assert first_value(1) != first_value(2)
    assert first_value(1) == first_value(1)


def test_qmc_gives_a_trial_its_point_whatever_was_drawn_before() -> None:
    study = optuna.create_study(sampler=RandomSampler())
    study.optimize(lambda trial: trial.suggest_float("x", 0.0, 1.0), n_trials=1)

    def value(number: int) -> float:
        study.sampler = make_sampler(SearchDefinition(sampler="qmc"), number, ONE_RANGE)
        return study.ask().suggest_float("x", 0.0, 1.0)

    drawn = [value(number) for number in (3, 2, 1, 2)]

    assert drawn == [0.75, 0.5, 0.0, 0.5]


@pytest.mark.parametrize(
    ("space", "trials", "expected"),
    [
        ({"filter.max_error": RANGE}, None, "refine"),
        ({"filter.max_error": RANGE, "robust.scale": RANGE}, None, "refine"),
        ({"filter.max_error": RANGE, "robust.kernel": {"values": ["huber", "cauchy"]}}, 9, "refine"),
        ({"filter.max_error": LIST}, None, "grid"),
        ({"filter.max_error": LIST, "robust.scale": LIST}, 5, "grid"),
        ({"filter.max_error": LIST, "robust.scale": LIST}, 4, "tpe"),
    ],
)
def test_without_a_name_the_space_chooses_the_sampler(space: dict[str, Any], trials: int | None, expected: str) -> None:
    data = definition_of(Path("room"), space=space)
    data["search"] = {"trials": trials}

    assert definition_from_dict(data).search.sampler == expected


def test_the_chosen_sampler_is_what_is_stored() -> None:
    data = definition_of(Path("room"))
    data["search"] = {}

    stored = definition_from_dict(data).model_dump(mode="json")

    assert stored["search"]["sampler"] == "refine"
    assert definition_from_dict(stored).search.sampler == "refine"


@pytest.mark.parametrize(
    ("sections", "what"),
    [
        ({"gtf": {"noisy_runs": {"min": 3, "max": 12}}}, "3 to 12"),
        ({"search": {"pruner": "wilcoxon"}}, "wilcoxon"),
    ],
)
def test_what_stopped_trials_early_is_refused_for_new_studies(
    sections: dict[str, Any], what: str, tmp_path: Path
) -> None:
    database = create_database(str(tmp_path / "studies.db"))

    with pytest.raises(DefinitionError, match=f"{what}.* is no longer part of gtf-tune"):
        create_study(database, _definition(**sections), tmp_path)


@pytest.mark.parametrize(
    ("options", "trials", "random"), [(1, 40, 10), (2, 100, 10), (5, 100, 20), (5, 45, 15), (5, 12, 10), (9, 300, 36)]
)
def test_tpe_begins_to_learn_later_where_there_are_more_options_but_not_too_late(
    options: int, trials: int, random: int
) -> None:
    assert startup_trials(options, trials) == random
