import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

from gtf_tune import display
from gtf_tune.report.dashboard import notes as markdown
from gtf_tune.report.drawing import markup


@pytest.mark.parametrize(
    ("value", "expected"),
    [
        (2.3149, "2.31"),
        (0.00231, "0.00231"),
        (1234.5, "1234"),
        (999.7, "1000"),
        (1.2e-7, "1.2e-07"),
        (math.nan, "-"),
        (0.0, "0"),
    ],
)
def test_numbers_have_three_significant_digits(value: float, expected: str) -> None:
    assert display.significant(value) == expected


@pytest.mark.parametrize(
    ("seconds", "expected"),
    [(0.42, "0.42 s"), (42.4, "42 s"), (200, "3 min 20 s"), (18720, "5 h 12 min"), (math.nan, "-")],
)
def test_durations_are_said_as_people_say_them(seconds: float, expected: str) -> None:
    assert display.duration(seconds) == expected


def test_other_numbers_carry_their_units() -> None:
    assert display.percent(0.123) == "+12.3 %"
    assert display.share(0.5) == "50 %"
    assert display.memory(3 * 2**29) == "1.5 GB"
    assert display.memory(0) == "-"
    assert display.interval(1.234, math.nan) == "-"
    assert [display.count(number, "trial") for number in (0, 1, 2)] == ["0 trials", "1 trial", "2 trials"]
    assert [display.value_text(value) for value in (True, 0.001, 3, "huber")] == ["true", "0.001", "3", "huber"]


@given(st.text())
def test_no_text_can_open_a_tag_or_leave_an_attribute(words: str) -> None:
    shown = markup.element("p", markup.text(words), title=words)

    inner = shown.removeprefix('<p title="').removesuffix("</p>")
    assert inner.count("<") == 0
    assert inner.count('"') == 1


def test_table_cells_are_escaped_unless_they_are_markup() -> None:
    shown = markup.table(["a", ">b"], [("<i>", markup.cell(markup.code("x<y")))])

    assert "&lt;i&gt;" in shown
    assert '<td class="number"><code>x&lt;y</code></td>' in shown


def test_a_snippet_can_be_copied() -> None:
    shown = markup.snippet("flags", "--a 1 && rm")

    assert "--a 1 &amp;&amp; rm" in shown
    assert 'class="copy"' in shown


@given(st.text())
def test_no_text_breaks_a_markdown_table(words: str) -> None:
    shown = markdown.table(["a"], [(markdown.inline_code(words),), (markdown.plain(words),)])

    assert len(shown.split("\n")) == 4
    unescaped = [row.replace("\\\\", "").replace("\\|", "").count("|") for row in shown.split("\n")]
    assert unescaped == [2, 2, 2, 2]
