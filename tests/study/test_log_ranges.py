"""A range in logarithms cannot hold 0, which is the default of some options."""

from pathlib import Path
from typing import Any

from gtf_tune.definition import RangeAxis, ValuesAxis
from gtf_tune.study.create import checked_definition
from tests.study.conftest import definition_of

RATIO = "verification.min_inlier_ratio"  # its default is 0
ERROR = "mapper.max_normalized_reproj_error"


def definition(room: Path, **pipeline: Any) -> dict[str, Any]:
    space = {
        RATIO: {"low": 0.01, "high": 1.0, "log": True, "points": 3},
        ERROR: {"low": 1e-3, "high": 1e-1, "log": True},
    }
    return definition_of(room, pipeline={"name": "glomap", **pipeline}, space=space)


def test_a_log_range_of_an_option_with_default_0_becomes_0_and_its_points(room: Path) -> None:
    space = checked_definition(definition(room), "test").space

    assert space[RATIO] == ValuesAxis(values=[0, 0.01, 0.1, 1.0])
    assert isinstance(space[ERROR], RangeAxis)


def test_where_the_users_baseline_is_not_0_the_range_stays(room: Path) -> None:
    space = checked_definition(definition(room, nominal={RATIO: 0.25}), "test").space

    assert isinstance(space[RATIO], RangeAxis)
