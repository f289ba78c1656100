import contextlib
import json
import tomllib
from pathlib import Path
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

from gtf_tune.definition import SideMetricDefinition, definition_from_dict, dump_definition, load_definition
from gtf_tune.definition.loading import section_from_dict
from gtf_tune.errors import DefinitionError

SOUND: dict[str, Any] = {
    "name": "photos",
    "pipeline": {"name": "glomap"},
    "sequences": [{"name": "photos", "path": "photos"}],
    "space": {"mapper.min_tri_angle_deg": {"low": 0.1, "high": 10.0, "log": True}},
}


def _refused(**sections: Any) -> str:
    with pytest.raises(DefinitionError) as raised:
        definition_from_dict({**SOUND, **sections}, "photos.toml")
    return str(raised.value)


def test_a_definition_survives_its_canonical_json() -> None:
    definition = definition_from_dict(SOUND)

    assert definition_from_dict(json.loads(dump_definition(definition))) == definition


@pytest.mark.parametrize(
    ("sections", "words"),
    [
        ({"serch": {}}, "unknown key 'serch'; did you mean 'search'?"),
        ({"sequences": [{"name": "a", "path": "a", "strid": 2}]}, "unknown key 'sequences[0].strid'"),
        ({"gtf": {"clean_runs": 0}}, "'gtf.clean_runs': should be greater than or equal to 1, not 0"),
        ({"gtf": {"noise_sigma": -1}}, "'gtf.noise_sigma': should lie in (0, 255] grey levels or be 'auto', not -1"),
        ({"gtf": {"noisy_runs": {"min": 9, "max": 3}}}, "min must not exceed max, not 9 and 3"),
        ({"space": {"a.b": {"low": 1.0, "high": 0.1}}}, "'space.\"a.b\"': low must be below high"),
        ({"space": {"a.b": {"low": 0.0, "high": 1.0, "log": True}}}, "a log axis needs low > 0"),
        ({"space": {"a.b": {"values": [1, 1]}}}, "values must differ"),
        ({"space": {"a.b": {"values": [1, 2, 1.0]}}}, "values must differ"),
        ({"space": {"a.b": {"low": 1.0}}}, "'space.\"a.b\".high' is missing"),
        ({"space": {}}, "'space'"),
        ({"name": "a b"}, "letters, digits"),
        ({"sequences": [{"name": "a", "path": "a", "holdout": True}]}, "at least one sequence must not be a holdout"),
        ({"pipeline": {"name": "glomap", "options": {"mapper.min_tri_angle_deg": 1.0}}}, "either fixed or searched"),
        ({"gtf": 5}, "'gtf': should be a table, not 5"),
        ({"space": {"a.b": {"values": [1], "logg": True}}}, "unknown key 'space.\"a.b\".logg'; known are values"),
    ],
)
def test_a_fault_is_named_with_its_place(sections: dict[str, Any], words: str) -> None:
    assert words in _refused(**sections)


@pytest.mark.parametrize(
    ("sections", "said"),
    [
        ({"gtf": {"noise_sigma": "aut"}}, "'gtf.noise_sigma': should be a number or 'auto', not 'aut'"),
        ({"gtf": {"noisy_runs": 2.5}}, "'gtf.noisy_runs': should be a whole number or a table, not 2.5"),
        ({"gtf": {"noisy_runs": {"mx": 3}}}, "unknown key 'gtf.noisy_runs.mx'; did you mean 'max'?"),
        (
            {"sequences": [{"name": "a", "path": "a", "camera": "unkown"}]},
            "'sequences[0].camera': should be a table, 'auto' or 'unknown', not 'unkown'",
        ),
        (
            {"sequences": [{"name": "a", "path": "a", "camera": {"model": "PINHOLE"}}]},
            "'sequences[0].camera.params' is missing",
        ),
        (
            {"pipeline": {"name": "glomap", "options": {"a.b": [1]}}},
            "'pipeline.options.\"a.b\"': should be true or false, a number or a text, not a list",
        ),
    ],
)
def test_a_place_that_takes_several_kinds_has_one_fault_in_plain_words(sections: dict[str, Any], said: str) -> None:
    assert _refused(**sections) == f"photos.toml: {said}"


def test_option_names_without_quotes_are_told_to_get_them() -> None:
    data = """
        pipeline = { name = "glomap", options = { mapper.ba.loss = 1, mapper.ba.scale = 2.0 } }
        [space]
        filter.max_error = { low = 1e-3, high = 1.0 }
        filter.method.kind = { values = ["a", "b"] }
        plain = { low = 1, hihg = 2 }
        """

    said = _refused(**tomllib.loads(data))

    assert said == "photos.toml: 6 faults: " + "; ".join(
        (
            "(1) 'space.filter.max_error': write the name in quotes: \"filter.max_error\" = ...",
            "(2) 'space.filter.method.kind': write the name in quotes: \"filter.method.kind\" = ...",
            "(3) 'pipeline.options.mapper.ba.loss': write the name in quotes: \"mapper.ba.loss\" = ...",
            "(4) 'pipeline.options.mapper.ba.scale': write the name in quotes: \"mapper.ba.scale\" = ...",
            "(5) 'space.plain.high' is missing",
            "(6) unknown key 'space.plain.hihg'; did you mean 'high'?",
        )
    )


def test_a_section_of_its_own_suggests_its_own_keys() -> None:
    with pytest.raises(DefinitionError, match=r"^--side: unknown key 'aligment'; did you mean 'alignment'\?$"):
        section_from_dict(SideMetricDefinition, {"aligment": "se3"}, "--side")


def test_all_faults_of_a_file_are_in_one_message() -> None:
    said = _refused(gtf={"clean_runs": 0, "metric": "ape"}, limits={"run_timeout_s": 0})

    assert said.startswith("photos.toml: 3 faults: (1) ")
    assert all(words in said for words in ("clean_runs", "metric", "run_timeout_s"))


def test_a_missing_file_and_broken_toml_are_named(tmp_path: Path) -> None:
    broken = tmp_path / "broken.toml"
    broken.write_text("name = \n")

    with pytest.raises(DefinitionError, match=r"broken\.toml: not valid TOML"):
        load_definition(broken)
    with pytest.raises(DefinitionError, match=r"none\.toml: there is no such file; give the path of a study def"):
        load_definition(tmp_path / "none.toml")


def test_sequences_of_one_name_are_refused() -> None:
    twice = [{"name": "a", "path": "a"}, {"name": "a", "path": "b"}]

    assert "different names" in _refused(sequences=twice)


JSON = st.recursive(
    st.none() | st.booleans() | st.integers() | st.floats(allow_nan=False) | st.text(max_size=5),
    lambda inner: st.lists(inner, max_size=3) | st.dictionaries(st.text(max_size=8), inner, max_size=3),
    max_leaves=10,
)


@given(st.dictionaries(st.sampled_from([*SOUND, "gtf", "search", "limits", "other"]), JSON))
def test_whatever_a_file_holds_only_a_definition_error_comes_out(data: dict[str, Any]) -> None:
    with contextlib.suppress(DefinitionError):
        assert definition_from_dict({**SOUND, **data}, "fuzz").name
