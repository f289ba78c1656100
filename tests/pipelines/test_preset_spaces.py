"""What is searched when nobody says suits the pipeline it is for."""

import pytest
from pydantic import TypeAdapter

from gtf_tune.definition import Axis
from gtf_tune.errors import DefinitionError
from gtf_tune.pipelines import create_pipeline
from gtf_tune.pipelines.preset_spaces import preset_pipelines, preset_space, searched_options
from gtf_tune.study.search.space import space_faults

EVERYTHING = 3


@pytest.mark.parametrize("name", preset_pipelines())
def test_every_axis_suits_its_pipeline(name: str) -> None:
    axes = preset_space(name).axes(EVERYTHING, unknown_intrinsics=True)

    checked = {option: TypeAdapter(Axis).validate_python(dict(axis)) for option, axis in axes.items()}

    assert len(checked) >= 2
    assert space_faults(checked, create_pipeline(name).options) == []


@pytest.mark.parametrize("name", preset_pipelines())
def test_what_is_tried_first_differs_and_lies_inside_what_is_always_searched(name: str) -> None:
    preset, table = preset_space(name), create_pipeline(name).options
    nominal = {option: table.specs[option].default for option in preset.axes()}

    configurations = [nominal, *({**nominal, **one} for one in preset.first)]

    assert preset.lead is None or dict(preset.lead.options) in preset.first
    assert all(set(one) == set(nominal) for one in configurations)
    assert all(configurations.count(one) == 1 for one in configurations)
    for one in configurations:
        table.check(one)
        for option, axis in preset.axes().items():
            assert axis["low"] <= one[option] <= axis["high"]


@pytest.mark.parametrize("name", preset_pipelines())
def test_baselines_are_options_that_the_pipeline_accepts_and_not_its_defaults(name: str) -> None:
    table = create_pipeline(name).options

    for baseline in preset_space(name).baselines:
        checked = table.check(dict(baseline.options))
        assert any(checked[option] != table.specs[option].default for option in checked)


def test_only_what_repeats_mapping_is_searched_by_default() -> None:
    assert set(preset_space("glomap").axes()) == {
        "mapper.bundle_adjustment.ceres.loss_function_scale",
        "mapper.max_normalized_reproj_error",
    }


def test_the_view_graph_is_searched_only_where_it_gives_the_focal_lengths() -> None:
    space = preset_space("glomap")

    known, unknown = (set(space.axes(space.tier("verification"), unknown_intrinsics=value)) for value in (False, True))

    assert {name.partition(".")[0] for name in unknown - known} == {"view_graph"}
    assert not space.depends_on_intrinsics(space.tier("mapping"))


def test_recommended_options_are_those_of_the_preset() -> None:
    searched = searched_options("glomap")

    assert searched["mapper.max_normalized_reproj_error"].tier == 1
    assert searched.keys() == preset_space("glomap").axes(EVERYTHING, unknown_intrinsics=True).keys()
    assert searched_options("analytic") == {}


def test_a_pipeline_without_a_preset_is_one_sentence() -> None:
    with pytest.raises(DefinitionError, match=r"nothing says what to search on pipeline 'orb'; name the options"):
        preset_space("orb")


def test_presets_search_more_from_one_to_the_next_and_ask_more_of_what_comes_before_the_mapper() -> None:
    space = preset_space("glomap")

    searched = [set(space.axes(space.tier(preset.name))) for preset in space.presets]

    assert searched[0] < searched[1] < searched[2]
    assert space.margins(searched[0]) == {}
    assert set(space.margins(searched[2])) == searched[2] - searched[0]
    assert min(space.margins(searched[2]).values()) > space.presets[0].margin


def test_an_unknown_preset_is_one_sentence_with_those_that_are_known() -> None:
    with pytest.raises(DefinitionError, match=r"'colmap' has no preset 'verify', only mapping") as caught:
        preset_space("colmap").tier("verify")

    assert caught.value.remedy == ("presets", "colmap")
