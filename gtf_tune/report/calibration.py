"""What a change of the score has meant for the true error, on sequences whose ground truth is known."""

import json
import math
from functools import cache
from importlib.resources import files
from typing import NamedTuple

FILE = "calibration.json"
"""Beside this module; ``python -m experiments.calibration`` writes it."""

PIPELINE = "glomap"
"""The pipeline that the cases were measured with; nothing is said of others."""

_ALIKE = 0.15
"""Distance of the logarithms up to which two changes of the score are alike: -27 % and -37 % to -15 %."""

_FEWEST = 6
_RISES = 0.02
_TENTH = 0.1


class Case(NamedTuple):
    """Changes of score and true error of a configuration against nominal on one sequence, -0.2 for -20 %."""

    sequence: str
    score: float
    true: float


@cache
def cases() -> tuple[Case, ...]:
    """Return all cases, from the packaged file."""
    stored = json.loads((files("gtf_tune.report") / FILE).read_text(encoding="utf-8"))
    return tuple(Case(*case) for case in stored["cases"])


def alike(change: float, known: tuple[Case, ...]) -> list[Case]:
    """Return the case of each sequence whose change of the score is nearest to a change, among those near enough."""
    nearest: dict[str, Case] = {}
    for case in sorted(known, key=lambda case: abs(_log(case.score) - _log(change))):
        if abs(_log(case.score) - _log(change)) <= _ALIKE:
            nearest.setdefault(case.sequence, case)
    return list(nearest.values())


def error_sentence(change: float, known: tuple[Case, ...]) -> str:
    """Return what a change of the score went with on the development sequences; empty where too few had such a one.

    Parameters
    ----------
    change
        Change of the score against nominal as a fraction, negative where it fell.
    known
        The cases to look among.
    """
    if not -1 < change < 0:
        return ""
    found = alike(change, known)
    if len(found) < _FEWEST:
        return ""
    trues, scores = sorted(case.true for case in found), sorted(case.score for case in found)
    outside = math.floor(_TENTH * len(trues))
    low, high = trues[outside], trues[-1 - outside]
    rose = [case.sequence for case in found if case.true > _RISES]
    also = f"; it rose on {len(rose)} of them ({', '.join(rose)})" if rose else ""
    return (
        f"What that means for the error: on {len(found)} sequences with ground truth, changes of GLOMAP's score by "
        f"{_whole(scores[0])} to {_whole(scores[-1])} % went with changes of the true error by {_whole(low)} to "
        f"{_whole(high)} % on eight in ten{also}."
    )


def _whole(change: float) -> str:
    return f"{100 * change:+.0f}"


def _log(change: float) -> float:
    return math.log1p(change)
