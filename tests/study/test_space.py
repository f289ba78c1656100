from pathlib import Path
from typing import Any

import optuna
import pytest
from hypothesis import given
from hypothesis import strategies as st
from optuna.distributions import CategoricalDistribution, FloatDistribution, IntDistribution

from gtf_tune.definition import definition_from_dict
from gtf_tune.errors import DefinitionError
from gtf_tune.pipelines import OptionSpec, OptionTable, create_pipeline
from gtf_tune.study.search.space import SearchSpace, build_space, space_faults
from tests.study.conftest import definition_of

TABLE = create_pipeline("analytic").options


def _space(sampler: str = "tpe", **axes: Any) -> SearchSpace:
    named = {name.replace("__", "."): axis for name, axis in axes.items()}
    return build_space(definition_from_dict(definition_of(Path("r"), space=named, search={"sampler": sampler})), TABLE)


def test_nominal_values_are_the_defaults_of_the_pipeline() -> None:
    space = _space(robust__kernel={"values": ["huber", "cauchy"]}, tracks__min_length={"low": 2, "high": 9})

    assert space.nominal == {"robust.kernel": "huber", "tracks.min_length": 3}


def test_a_log_range_has_evenly_spaced_points_in_logarithms() -> None:
    space = _space(filter__max_error={"low": 1e-4, "high": 1.0, "log": True, "points": 5})

    assert space.axes[0].grid == (1e-4, 1e-3, 1e-2, 1e-1, 1.0)
    assert space.axes[0].distribution == FloatDistribution(1e-4, 1.0, log=True)
    assert space.axes[0].is_log


def test_a_step_rules_the_points_of_a_linear_range() -> None:
    space = _space(matching__max_ratio={"low": 0.5, "high": 0.9, "step": 0.1})

    assert space.axes[0].grid == (0.5, 0.6, 0.7, 0.8, 0.9)


def test_whole_numbers_appear_once() -> None:
    space = _space(tracks__min_length={"low": 2, "high": 5, "points": 9})

    assert space.axes[0].grid == (2, 3, 4, 5)
    assert space.axes[0].distribution == IntDistribution(2, 5)


@given(st.floats(1e-6, 1e-3), st.floats(0.02, 1.0), st.integers(2, 20))
def test_points_of_a_range_lie_inside_it_and_touch_its_ends(low: float, high: float, points: int) -> None:
    grid = _space(filter__max_error={"low": low, "high": high, "log": True, "points": points}).axes[0].grid

    assert len(grid) == points
    assert grid[0] == pytest.approx(low)
    assert grid[-1] == pytest.approx(high)
    assert all(low <= float(value) <= high for value in grid)


def test_a_grid_has_every_combination_once_and_nominal_apart() -> None:
    space = _space("grid", filter__max_error={"values": [0.001, 0.01]}, tracks__min_length={"values": [3, 4]})

    points = list(space.grid())

    assert space.grid_size() == 4 == len(points) + 1
    assert space.nominal not in points
    assert points[0] == {"filter.max_error": 0.001, "tracks.min_length": 3}


def test_a_grid_without_the_nominal_point_is_one_larger() -> None:
    assert _space("grid", filter__max_error={"values": [0.001, 0.002]}).grid_size() == 3


def test_lists_are_choices_with_nominal_among_them() -> None:
    space = _space(filter__max_error={"values": [0.001, 0.002]})

    assert space.axes[0].distribution == CategoricalDistribution((0.01, 0.001, 0.002))


def test_a_grid_keeps_numeric_lists_on_a_numeric_axis() -> None:
    space = _space("grid", filter__max_error={"values": [0.001, 0.1]})

    assert space.axes[0].distribution == FloatDistribution(0.001, 0.1, log=True)


def test_samplers_get_values_of_the_right_type() -> None:
    space = _space(
        filter__max_error={"low": 1e-4, "high": 0.1, "log": True},
        tracks__min_length={"low": 2, "high": 9},
        robust__kernel={"values": ["huber", "cauchy"]},
        refine__intrinsics={"values": [True, False]},
    )
    study = optuna.create_study(sampler=optuna.samplers.RandomSampler(seed=0))

    chosen = space.suggest(study.ask())

    assert {name: type(value) for name, value in chosen.items()} == {
        "filter.max_error": float,
        "tracks.min_length": int,
        "robust.kernel": str,
        "refine.intrinsics": bool,
    }


@pytest.mark.parametrize(
    ("name", "axis", "reason"),
    [
        ("filter.max_eror", {"low": 0.1, "high": 1.0}, "did you mean 'filter.max_error'"),
        ("robust.kernel", {"low": 0.1, "high": 1.0}, "takes one of"),
        ("filter.max_error", {"low": 0.1, "high": 1.0}, "leaves out the pipeline's default 0.01"),
        ("filter.max_error", {"low": 0.001, "high": 5.0}, r"must lie in \[1e-06, 1\]"),
        ("tracks.min_length", {"values": [2, 2.5]}, "takes a whole number"),
    ],
)
def test_an_axis_that_does_not_suit_the_pipeline_is_refused(name: str, axis: dict[str, Any], reason: str) -> None:
    with pytest.raises(DefinitionError, match=reason):
        build_space(definition_from_dict(definition_of(Path("r"), space={name: axis})), TABLE)


def test_the_faults_of_all_axes_come_together() -> None:
    definition = definition_from_dict(
        definition_of(Path("r"), space={"no.such": {"low": 1, "high": 2}, "filter.max_error": {"values": ["x"]}})
    )

    assert len(space_faults(definition.space, TABLE)) == 2


@pytest.mark.parametrize(
    ("axis", "reason"),
    [
        ({"low": 2, "high": 10, "step": 0.5}, "takes whole numbers; its step cannot be 0.5"),
        ({"low": 2, "high": 10, "step": 1.5}, "takes whole numbers; its step cannot be 1.5"),
        ({"low": 2, "high": 4, "step": 5}, "has no room for a step of 5"),
    ],
)
def test_a_step_that_cannot_be_kept_to_is_refused(axis: dict[str, Any], reason: str) -> None:
    with pytest.raises(DefinitionError, match=reason):
        _space(tracks__min_length=axis)


def test_nothing_is_said_of_a_range_and_a_nominal_value_between_two_steps() -> None:
    space = _space(tracks__min_length={"low": 2, "high": 11, "step": 4})  # warnings are errors in tests
    study = optuna.create_study()
    study.enqueue_trial(space.nominal)

    assert space.suggest(study.ask()) == {"tracks.min_length": 3}
    assert space.axes[0].distribution == IntDistribution(2, 10, step=4)


def test_a_step_as_large_as_its_range_has_two_points() -> None:
    space = _space(matching__max_ratio={"low": 0.7, "high": 0.8, "step": 0.1})  # 0.8 - 0.7 is less than 0.1

    assert space.axes[0].grid == (0.7, 0.8)


def test_words_of_digits_are_searched_as_words() -> None:
    table = OptionTable("p", {"preset": OptionSpec("preset", "0", choices=("0", "2"))})
    data = definition_of(Path("r"), space={"preset": {"values": [0, 2]}}, search={"sampler": "grid"})

    (axis,) = build_space(definition_from_dict(data), table).axes

    assert axis.grid == ("0", "2")
    assert axis.distribution == CategoricalDistribution(("0", "2"))
