"""What follows the search depends on what it found and on the time that is left."""

from types import SimpleNamespace
from typing import Any

import pytest

from gtf_tune.study.outcome.recommendation import NOTHING_BETTER, NOTHING_FEASIBLE, UNCONFIRMED
from gtf_tune.study.runs.stop import StopRequest
from gtf_tune.study.tune import phases
from gtf_tune.study.tune.budget import REDUCTIONS, Budget, Plan, RunPrice
from gtf_tune.study.tune.pace import Pace
from gtf_tune.study.tune.phases import Means, tune_through

PLAN = Plan(10, 4, REDUCTIONS[0], 0.0, 0.0, 0.0, RunPrice(20.0, 5.0), RunPrice(0.0, 0.0))


@pytest.mark.parametrize(
    ("decision", "compares", "confirmed"),
    [(NOTHING_FEASIBLE, True, []), (UNCONFIRMED, True, ["asked"]), (NOTHING_BETTER, False, [])],
)
def test_a_search_without_a_feasible_trial_beside_nominal_ends_there_and_not_in_an_error(
    monkeypatch: pytest.MonkeyPatch, decision: str, compares: bool, confirmed: list[str]
) -> None:
    found, asked = SimpleNamespace(decision=decision, is_confirmed=False, compares=compares), list[str]()
    study: Any = SimpleNamespace(database=None, record=SimpleNamespace(id=1))
    monkeypatch.setattr(phases, "recommend", lambda *_: found)
    monkeypatch.setattr(phases, "confirmations", SimpleNamespace(of_study=lambda *_: []))
    monkeypatch.setattr(phases, "_search", lambda *_: None)
    monkeypatch.setattr(phases, "_candidates", lambda *_: ())
    monkeypatch.setattr(phases, "_confirm", lambda *_: asked.append("asked"))

    executor: Any = None
    done = tune_through(study, Means(executor, StopRequest(), pace=Pace(PLAN, Budget(3600, 1, 7))))

    assert done is found
    assert asked == confirmed
