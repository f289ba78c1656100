"""Option values are checked by name, type and range."""

import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

from gtf_tune.errors import OptionError
from gtf_tune.pipelines import OptionSpec, OptionTable, option_text

SPECS = (
    OptionSpec("mapper.max_error", 4.0, low=0.0),
    OptionSpec("mapper.rounds", 3, low=1, high=9),
    OptionSpec("mapper.refine", True),
    OptionSpec("mapper.kernel", "huber", choices=("huber", "cauchy")),
    OptionSpec("mapper.prefix", "a"),
)
TABLE = OptionTable("p", {spec.name: spec for spec in SPECS})


def test_values_get_their_canonical_type() -> None:
    checked = TABLE.check({"mapper.rounds": 2.0, "mapper.max_error": 1})

    assert checked == {"mapper.max_error": 1.0, "mapper.rounds": 2}
    assert [type(value) for value in checked.values()] == [float, int]


def test_a_word_of_digits_may_be_given_as_a_number() -> None:
    table = OptionTable("p", {"preset": OptionSpec("preset", "0", choices=("0", "2"))})

    assert table.check({"preset": 2}) == {"preset": "2"}
    with pytest.raises(OptionError, match="takes one of 0, 2, not 5"):
        table.check({"preset": 5})


@pytest.mark.parametrize(
    ("name", "value", "kind"),
    [
        ("mapper.max_error", "4", "a number"),
        ("mapper.max_error", math.nan, "a number"),
        ("mapper.max_error", True, "a number"),
        ("mapper.rounds", 2.5, "a whole number"),
        ("mapper.refine", 1, "true or false"),
        ("mapper.kernel", "hubert", "one of huber, cauchy"),
        ("mapper.prefix", 3, "a text"),
    ],
)
def test_wrong_types_are_refused_by_name(name: str, value: object, kind: str) -> None:
    with pytest.raises(OptionError, match=f"'{name}' takes {kind}"):
        TABLE.check({name: value})


def test_values_outside_the_range_are_refused() -> None:
    with pytest.raises(OptionError, match=r"must lie in \[1, 9\], not 10"):
        TABLE.check({"mapper.rounds": 10})


def test_all_faults_are_named_at_once() -> None:
    with pytest.raises(OptionError, match=r"max_eror.*did you mean 'mapper.max_error'.*'mapper.rounds' takes"):
        TABLE.check({"mapper.max_eror": 1.0, "mapper.rounds": "x"})


def test_a_field_under_another_prefix_is_suggested() -> None:
    with pytest.raises(OptionError, match=r"did you mean 'mapper\.kernel'"):
        TABLE.check({"completely.different.path.kernel": "huber"})


@given(st.dictionaries(st.text(max_size=20), st.none() | st.integers() | st.text() | st.floats()))
def test_whatever_is_given_is_checked_or_refused(values: dict[str, object]) -> None:
    try:
        checked = TABLE.check(values)
    except OptionError:
        return
    assert set(checked) == set(values) <= set(TABLE.specs)


def test_values_are_written_as_they_are_typed() -> None:
    values = (True, False, 3, 0.1234567, 1e-5, "huber", "True")

    assert [option_text(value) for value in values] == ["true", "false", "3", "0.1234567", "1e-05", "huber", "True"]
    assert [option_text(value, digits=3) for value in values[1:5]] == ["false", "3", "0.123", "1e-05"]


def test_a_refused_truth_value_is_named_as_it_is_typed() -> None:
    with pytest.raises(OptionError, match=r"'mapper\.max_error' takes a number, not true"):
        TABLE.check({"mapper.max_error": True})
