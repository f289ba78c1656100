"""What is stored of a confirmation keeps its keys, whatever version wrote it."""

import json
import math
from typing import Any

import pytest

from gtf_tune.study.outcome.verdict import Verdict

EFFECT = {"improvement": 0.27, "low": 0.2, "high": 0.33, "p_value": 0.001, "instances": 10}
UNKNOWN = {"improvement": None, "low": None, "high": None, "p_value": None, "instances": 0}
STORED: dict[str, Any] = {
    "verdict": "adopt",
    "adopted": 1,
    "candidates": [
        {
            "ordinal": 1,
            "options": {"filter.max_error": 0.003},
            **EFFECT,
            "adjusted_p_value": 0.002,
            "verdict": "adopt",
            "reasons": [],
            "by_sequence": {
                "room": {"value": 0.002, "coverage": 1.0, "collapsed": 0, **EFFECT, "holdout": False},
                "hall": {"value": None, "coverage": 0.4, "collapsed": 3, **UNKNOWN, "holdout": True},
            },
            "value": 0.73,
        },
        {
            "ordinal": 5,
            "options": {"filter.max_error": 0.008},
            **UNKNOWN,
            "adjusted_p_value": 1.0,
            "verdict": "keep nominal",
            "reasons": ["cannot be compared with nominal: too few runs worked under both"],
            "by_sequence": {},
            "value": None,
        },
    ],
    "nominal": {
        "ordinal": 0,
        "options": {"filter.max_error": 0.01},
        "by_sequence": {"room": {"value": 0.0027, "coverage": 1.0, "collapsed": 0}},
    },
    "runs": 10,
}


def test_a_verdict_is_stored_and_printed_as_before_byte_by_byte() -> None:
    assert json.dumps(Verdict.from_json(STORED, "adopt").as_json()) == json.dumps(STORED)


def test_a_stored_verdict_is_read_with_its_types() -> None:
    verdict = Verdict.from_json(STORED, "adopt")

    adopted, other = verdict.candidates
    assert (verdict.word, verdict.adopted, verdict.noisy_runs) == ("adopt", 1, 10)
    assert (adopted.improvement.value, adopted.improvement.low, adopted.improvement.high) == (0.27, 0.2, 0.33)
    assert (adopted.by_sequence["room"].p_value, adopted.by_sequence["hall"].is_holdout) == (0.001, True)
    assert math.isnan(other.improvement.value)
    assert math.isnan(other.value)
    assert verdict.leading is verdict.adopted_candidate is adopted


def test_a_confirmation_without_candidates_is_read() -> None:
    stored = {"verdict": "keep nominal", "adopted": None, "candidates": [], "nominal": None, "runs": 16}

    verdict = Verdict.from_json(stored, "keep nominal")

    assert verdict.as_json() == stored
    assert (verdict.leading, verdict.adopted_candidate) == (None, None)


@pytest.mark.parametrize("missing", ["nominal", "runs", "candidates"])
def test_a_confirmation_of_an_early_version_that_lacks_a_key_is_read(missing: str) -> None:
    verdict = Verdict.from_json({key: value for key, value in STORED.items() if key != missing}, "adopt")

    assert (verdict.word, verdict.adopted) == ("adopt", 1)


def test_the_word_that_is_stored_beside_the_result_counts() -> None:
    assert Verdict.from_json(STORED, "none").word == "none"


def test_options_that_were_measured_are_known_as_such() -> None:
    verdict = Verdict.from_json(STORED, "adopt")

    assert [verdict.compared({"filter.max_error": value}) for value in (0.01, 0.003, 0.008, 0.5)] == [
        True,
        True,
        True,
        False,
    ]
