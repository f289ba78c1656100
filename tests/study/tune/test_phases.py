"""What follows the search depends on what it found and on the time that is left."""

from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest

from gtf_tune.execution import InlineExecutor
from gtf_tune.store import trials
from gtf_tune.store.database import Database
from gtf_tune.study.events import Event, TrialFinished
from gtf_tune.study.open_study import open_study
from gtf_tune.study.outcome.recommendation import NOTHING_BETTER, NOTHING_FEASIBLE, UNCONFIRMED
from gtf_tune.study.runs.stop import FINISH_RUNS, StopRequest
from gtf_tune.study.tune import phases
from gtf_tune.study.tune.budget import REDUCTIONS, Budget, Plan, RunPrice
from gtf_tune.study.tune.pace import Pace
from gtf_tune.study.tune.phases import Means, tune_through
from tests.study.conftest import Runner, definition_of

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


def test_a_trial_that_shortens_the_best_one_does_not_take_up_a_search_that_ended_early(
    database: Database, room: Path, run_study: Runner
) -> None:
    stop = StopRequest()

    def end_after_three(event: Event) -> None:
        if isinstance(event, TrialFinished) and event.number == 2:
            stop.ask(FINISH_RUNS)

    run_study(definition_of(room), stop=stop, callbacks=[end_after_three])
    study = open_study(database, "small")
    pace = Pace(PLAN, Budget(1e6, 1, 7), done=3)

    found = phases._try(study, Means(InlineExecutor(), StopRequest(), pace=pace), {"filter.max_error": 0.05})

    ended = [trial for trial in trials.of_study(database, study.record.id) if trial.state == "complete"]
    assert found is not None
    assert found.options == {"filter.max_error": 0.05}
    assert len(ended) == 4
    assert pace.done == 4
