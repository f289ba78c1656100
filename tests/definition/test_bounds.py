"""New definitions ask for what can be done; stored ones are read whatever they ask for."""

import os
from pathlib import Path
from typing import Any

import pytest

from gtf_tune.cli.values import parse_options
from gtf_tune.definition import definition_from_dict, read_toml
from gtf_tune.errors import DefinitionError, StorageError
from gtf_tune.pipelines import create_pipeline
from gtf_tune.store.database.engine import parse_url
from gtf_tune.study.create import checked_definition

EXCESSIVE: list[tuple[str, Any]] = [
    ("gtf.noisy_runs", 10**9),
    ("gtf.noisy_runs", {"min": 2, "max": 10**9}),
    ("gtf.rpe_delta", 1e300),
    ("side_metric.rpe_delta", 1e12),
    ("limits.run_timeout_s", 1e-300),
    ("limits.run_memory_gb", 1e-300),
    ("sequences.0.stride", 10**12),
    ("sequences.0.rate_hz", 1e300),
    ("sequences.0.rate_hz", 1e-300),
    ("sequences.0.max_image_size", 10**9),
    ("space.filter.max_error", {"low": 1e-3, "high": 0.1, "step": 1e-300}),
    ("space.filter.max_error", {"low": 1e-3, "high": 0.1, "points": 10**9}),
]


def definition(place: str = "", value: object = None) -> dict[str, Any]:
    data: dict[str, Any] = {
        "name": "bounds",
        "pipeline": {"name": "analytic"},
        "sequences": [{"name": "room", "path": "room"}],
        "space": {"filter.max_error": {"low": 1e-3, "high": 0.1}},
    }
    if place:
        section, _, key = place.partition(".")
        inside: Any = data.setdefault(section, {})
        number, _, field = key.partition(".")
        if number.isdigit():
            inside[int(number)][field] = value
        else:
            inside[key] = value
    return data


@pytest.mark.parametrize(("place", "value"), EXCESSIVE)
def test_what_cannot_be_meant_is_refused_when_a_study_is_created(place: str, value: object) -> None:
    with pytest.raises(DefinitionError, match=place.rpartition(".")[2]):
        checked_definition(definition(place, value), "new.toml")


@pytest.mark.parametrize(("place", "value"), [one for one in EXCESSIVE if "points" not in str(one)])
def test_it_is_read_where_it_is_stored(place: str, value: object) -> None:
    assert definition_from_dict(definition(place, value), "stored")


@pytest.mark.parametrize("place", ["gtf.noisy_runs", "search.trials", "pipeline.options", "space.filter.max_error"])
def test_a_number_of_hundreds_of_digits_is_refused_in_words(place: str) -> None:
    value: object = {"robust.scale": 10**400} if place == "pipeline.options" else 10**400
    value = {"low": 0, "high": 10**400} if place.startswith("space") else value

    with pytest.raises(DefinitionError, match="at most 18 digits"):
        checked_definition(definition(place, value), "new.toml")


@pytest.mark.parametrize(
    "content", ["a = " + "[" * 20_000, "a = " + "{a=" * 300 + "1" + "}" * 300, f"a = {'9' * 5000}"]
)
def test_a_file_of_great_depth_or_length_is_refused_in_words(tmp_path: Path, content: str) -> None:
    path = tmp_path / "deep.toml"
    path.write_text(content)

    with pytest.raises(DefinitionError, match=r"deep\.toml: not valid TOML: (values are nested|a number has)"):
        read_toml(path)


def test_a_pipe_in_place_of_a_file_is_refused_and_not_waited_for(tmp_path: Path) -> None:
    os.mkfifo(tmp_path / "pipe.toml")

    with pytest.raises(DefinitionError, match="a pipe or a device"):
        read_toml(tmp_path / "pipe.toml")
    with pytest.raises(StorageError, match="a pipe or a device"):
        parse_url(f"@{tmp_path / 'pipe.toml'}")
    with pytest.raises(DefinitionError, match="a pipe or a device"):
        parse_options([str(tmp_path / "pipe.toml")], "--nominal")
    with pytest.raises(DefinitionError, match="a pipe or a device"):
        create_pipeline("command", {"definition": str(tmp_path / "pipe.toml")})
