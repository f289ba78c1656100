"""Random definitions, options and trajectory files: whatever comes, the answer is a value or one sentence."""

import os
import struct
import subprocess
import sys
from typing import Any

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from gtf_tune.definition import StudyDefinition, load_definition
from gtf_tune.errors import DefinitionError, OptionError, TrajectoryError
from gtf_tune.pipelines import OptionTable, create_pipeline
from gtf_tune.study.create import checked_definition
from gtf_tune.study.search.space import build_space
from gtf_tune.trajectory import read_trajectory

CASES = int(os.environ.get("GTF_TUNE_FUZZ_CASES", "100"))
SOAKED = "GTF_TUNE_FUZZ_CASES" in os.environ  # draws other cases each time
SLOWLY = settings(max_examples=CASES, deadline=None, derandomize=not SOAKED, suppress_health_check=list(HealthCheck))

VALID: dict[str, Any] = {
    "name": "fuzz",
    "pipeline": {"name": "analytic", "options": {"robust.kernel": "huber"}},
    "sequences": [{"name": "room", "path": "room"}],
    "space": {"filter.max_error": {"low": 1e-3, "high": 0.1, "log": True}},
    "gtf": {"clean_runs": 2, "noisy_runs": 6, "noise_sigma": 5.0},
    "search": {"sampler": "tpe", "trials": 8},
    "limits": {"run_timeout_s": 600},
}
WORDS = st.sampled_from(
    [*VALID, "values", "points", "holdout", "sampler", "auto", "glomap", "command", "filter.max_error", "settings", ""]
)
EXTREMES = st.sampled_from([10**400, -(10**30), 2**63, 10**9, 1e300, -1e300, 1e-300, 5e-324, -0.0])
LEAVES = EXTREMES | st.none() | st.booleans() | st.integers() | st.floats() | st.text(max_size=20) | WORDS
VALUES = st.recursive(LEAVES, lambda inner: st.lists(inner, max_size=3) | st.dictionaries(WORDS, inner, max_size=3))


@st.composite
def damaged_definitions(draw: st.DrawFn) -> dict[str, Any]:
    """Draw a definition with some of its parts replaced, removed or added."""
    data = {name: dict(value) if isinstance(value, dict) else value for name, value in VALID.items()}
    for _ in range(draw(st.integers(1, 3))):
        section = draw(st.sampled_from(sorted(data)) | WORDS)
        inside = data.get(section)
        if isinstance(inside, dict) and draw(st.booleans()):
            inside[draw(st.sampled_from(sorted(inside) or ["x"]) | WORDS)] = draw(VALUES)
        else:
            data[section] = draw(VALUES)
    return data


@SLOWLY
@given(damaged_definitions())
def test_a_damaged_definition_is_accepted_or_refused_in_words(data: dict[str, Any]) -> None:
    try:
        definition = checked_definition(data, "fuzz.toml")
    except DefinitionError as error:
        assert "fuzz.toml" in str(error)  # noqa: PT017 (either answer is right)
    else:
        _assert_searchable(definition)


@SLOWLY
@given(st.data())
def test_a_range_of_any_bounds_is_searchable_or_refused_in_words(data: st.DataObject) -> None:
    numbers = EXTREMES | st.floats() | st.integers()
    axis = data.draw(
        st.fixed_dictionaries({"low": numbers, "high": numbers}, optional={"step": numbers, "log": st.booleans()})
    )

    try:
        definition = checked_definition({**VALID, "space": {"filter.max_error": axis}}, "fuzz.toml")
    except DefinitionError as error:
        assert "fuzz.toml" in str(error)  # noqa: PT017 (either answer is right)
    else:
        _assert_searchable(definition)


def _assert_searchable(definition: StudyDefinition) -> None:
    space = build_space(definition, create_pipeline(definition.pipeline.name, definition.pipeline.settings).options)

    assert space.grid_size() >= 1
    assert all(axis.takes(axis.nominal) for axis in space.axes)


@SLOWLY
@given(st.text(max_size=300) | st.binary(max_size=300))
def test_a_file_of_anything_is_refused_in_words(tmp_path_factory: pytest.TempPathFactory, content: str | bytes) -> None:
    path = tmp_path_factory.getbasetemp() / "fuzz.toml"
    path.write_bytes(content if isinstance(content, bytes) else content.encode("utf-8", "surrogatepass"))

    with pytest.raises(DefinitionError, match=r"fuzz\.toml"):
        load_definition(path)


@pytest.fixture(scope="module", params=["analytic", "glomap"])
def table(request: pytest.FixtureRequest) -> OptionTable:
    return create_pipeline(request.param).options


@SLOWLY
@given(data=st.data())
def test_an_option_takes_a_value_of_its_type_or_refuses_it_in_words(table: OptionTable, data: st.DataObject) -> None:
    name = data.draw(st.sampled_from(sorted(table.specs)) | st.text(max_size=10))
    value = data.draw(VALUES)

    try:
        taken = table.check({name: value})
    except OptionError as error:
        taken = {}
        assert name[:5] in str(error)  # noqa: PT017 (either answer is right)

    assert all(type(taken[one]) is type(table.specs[one].default) for one in taken)


POSE_LINES = {
    "tum": "{n} 1 2 3 0 0 0 1",
    "kitti": "1 0 0 {n} 0 1 0 2 0 0 1 3",
    "euroc": "{n}000000000,1,2,3,1,0,0,0",
    "colmap": "{n} 1 0 0 0 1 2 3 1 {n}.png\n",
}
DAMAGE = st.sampled_from(["", " ", ",", "\n", "nan", "-inf", "1e999", "#", "0", "-1", "é", "\0", "1_0", "0x1", "2.png"])


@st.composite
def damaged_poses(draw: st.DrawFn) -> tuple[str, bytes]:
    """Draw a format, and a file of it with some of its characters replaced, removed or added, or cut short."""
    kind = draw(st.sampled_from(sorted(POSE_LINES)))
    text = "\n".join(POSE_LINES[kind].format(n=number) for number in range(draw(st.integers(0, 4))))
    for _ in range(draw(st.integers(0, 3))):
        start = draw(st.integers(0, len(text)))
        text = text[:start] + draw(DAMAGE) + text[start + draw(st.integers(0, 3)) :]
    content = text.encode()
    return kind, content[: draw(st.integers(0, len(content)))] if draw(st.booleans()) else content


@SLOWLY
@given(damaged_poses(), st.booleans())
def test_a_damaged_trajectory_file_is_read_or_refused_in_words(
    tmp_path_factory: pytest.TempPathFactory, file: tuple[str, bytes], told: bool
) -> None:
    kind, content = file
    path = tmp_path_factory.getbasetemp() / ("images.txt" if kind == "colmap" else "poses.txt")
    path.write_bytes(content)

    try:
        poses = read_trajectory(path, format=kind if told else "auto")  # type: ignore[arg-type]
    except TrajectoryError as error:
        assert path.name in str(error)  # noqa: PT017 (either answer is right)
        return

    assert len(poses) > 0
    assert np.isfinite(poses.positions).all()
    assert (np.diff(poses.timestamps) > 0).all()


@SLOWLY
@given(st.binary(max_size=300), st.integers(0, 3))
def test_a_model_of_any_bytes_is_read_or_refused_in_words(
    tmp_path_factory: pytest.TempPathFactory, tail: bytes, count: int
) -> None:
    path = tmp_path_factory.getbasetemp() / "images.bin"
    image = struct.pack("<I7dI", 1, 1.0, 0.0, 0.0, 0.0, 1.0, 2.0, 3.0, 1) + b"a.png\0" + struct.pack("<Q", 0)
    path.write_bytes(struct.pack("<Q", count) + image + tail)

    try:
        poses = read_trajectory(path)
    except TrajectoryError as error:
        assert path.name in str(error)  # noqa: PT017 (either answer is right)
        return

    assert len(poses) == count


KINDS = ("damaged_definition", "file_of_anything", "option_takes", "damaged_trajectory", "model_of_any_bytes")


@pytest.mark.soak
@pytest.mark.parametrize("kind", KINDS)
def test_ten_thousand_cases_of_each_kind(kind: str) -> None:
    """Run the tests above, each for a hundred times as long; seven of them take six minutes of one core in all."""
    environment = {**os.environ, "GTF_TUNE_FUZZ_CASES": "10000"}
    command = [sys.executable, "-m", "pytest", "-n0", "-q", "--durations=3", __file__, "-k", kind]
    assert subprocess.run(command, env=environment, check=False).returncode == 0


def test_the_valid_definition_is_valid() -> None:
    assert checked_definition(VALID, "fuzz.toml").name == "fuzz"
