"""Options that carry nothing go back to nominal."""

from collections.abc import Mapping
from pathlib import Path

from gtf_tune.pipelines import OptionValue
from gtf_tune.store import studies, trials
from gtf_tune.store.database import Database
from gtf_tune.store.trials import Trial
from gtf_tune.study.enqueue import enqueue
from gtf_tune.study.tune.ablation import shortened
from tests.study.conftest import Runner, definition_of

SPACE = {
    "filter.max_error": {"low": 3e-4, "high": 0.1, "log": True},
    "robust.scale": {"low": 0.1, "high": 2.0},
    "refine.intrinsics": {"values": [True, False]},
}
BEST: Mapping[str, OptionValue] = {"filter.max_error": 0.002, "robust.scale": 0.99, "refine.intrinsics": True}
NOTHING = {"settings": {"collapse_rate": 0.0}}


def test_only_the_option_that_carries_the_gain_is_left(room: Path, database: Database, run_study: Runner) -> None:
    data = definition_of(room, space=SPACE, pipeline=NOTHING, search={"trials": 1, "first": [BEST]})
    run_study(data)
    study_id = studies.get(database, "small").id
    tried: list[Mapping[str, OptionValue]] = []

    def attempt(options: Mapping[str, OptionValue]) -> Trial:
        tried.append(options)
        number = enqueue(database, "small", options)
        run_study(data)
        return trials.get(database, study_id, number)

    found = shortened(database, trials.get(database, study_id, 0), trials.get(database, study_id, 1), attempt)

    assert found.options == {**BEST, "robust.scale": 1.0}
    assert tried == [{**BEST, "filter.max_error": 0.01}, {**BEST, "robust.scale": 1.0}]


def test_without_time_the_best_trial_stays_as_it_is(room: Path, database: Database, run_study: Runner) -> None:
    run_study(definition_of(room, space=SPACE, pipeline=NOTHING, search={"trials": 1, "first": [BEST]}))
    study_id = studies.get(database, "small").id
    nominal, best = (trials.get(database, study_id, number) for number in (0, 1))

    assert shortened(database, nominal, best, lambda options: None) == best
