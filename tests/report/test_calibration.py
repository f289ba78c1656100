"""What the report says that a change of the score means for the true error."""

import pytest

from gtf_tune.report.calibration import Case, alike, cases, error_sentence

KNOWN = tuple(Case(f"s{number}", -0.3 + 0.01 * number, -0.02 * number) for number in range(1, 11))


def test_the_case_of_each_sequence_that_is_most_alike_counts() -> None:
    known = (Case("a", -0.35, 0.1), Case("a", -0.28, -0.2), Case("b", -0.1, -0.3), Case("c", -0.25, -0.1))

    assert {case.true for case in alike(-0.27, known)} == {-0.2, -0.1}


def test_the_sentence_leaves_out_a_tenth_on_either_side() -> None:
    assert error_sentence(-0.25, KNOWN) == (
        "What that means for the error: on 10 sequences with ground truth, changes of GLOMAP's score by -29 to -20 % "
        "went with changes of the true error by -18 to -4 % on eight in ten."
    )


def test_the_sentence_names_the_sequences_where_the_error_rose() -> None:
    known = (*KNOWN, Case("street", -0.25, 0.07))

    assert error_sentence(-0.25, known).endswith("; it rose on 1 of them (street).")


@pytest.mark.parametrize("change", [-0.6, 0.0, 0.2, -1.0, float("nan")])
def test_nothing_is_said_where_few_sequences_had_such_a_change(change: float) -> None:
    assert error_sentence(change, KNOWN) == ""


def test_the_packaged_cases_speak_for_changes_that_confirmations_find() -> None:
    assert len({case.sequence for case in cases()}) > 10
    for change in (-0.1, -0.2, -0.3, -0.4):
        assert "sequences with ground truth" in error_sentence(change, cases())
