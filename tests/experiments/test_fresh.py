import json
import math
from dataclasses import asdict
from pathlib import Path

import numpy as np
import pytest

from experiments.fresh import FreshError, fresh_sentence, fresh_table, judged
from experiments.plan import OPTIONS, Experiment
from experiments.settings import Outcome
from experiments.stored import stored_fresh
from gtf_tune.study.outcome.verdict import Candidate
from tests.experiments.test_experiment_outcomes import setting

NAME = OPTIONS["huber"].name
OUTCOME = Outcome(
    Experiment("dtu-scan24", OPTIONS["huber"], 2.0), (setting(0, 1.0), setting(1, 0.9)), setting(1, 0.9), "adopt"
)
NOMINAL = dict(enumerate(np.exp(0.5 * np.random.default_rng(0).standard_normal(12)).tolist()))


def row(improvement: float | None = 0.2) -> Candidate:
    return Candidate.from_json({"ordinal": 1, "options": {NAME: 2.0}, "improvement": improvement})


def candidate(ratios: list[float]) -> FreshError:
    own = {index: NOMINAL[index] * ratio for index, ratio in enumerate(ratios)}
    return judged(OUTCOME, row(), NOMINAL, own, is_adopted=True)


def test_runs_are_paired_by_noise_and_one_collapse_decides_nothing() -> None:
    ratios = [0.8 * (1.01 if index % 2 else 0.99) for index in range(12)]

    calm, broken = candidate(ratios), candidate([*ratios[:-1], 1e4])

    assert calm.change == pytest.approx(-0.2, abs=1e-3)
    assert calm.low < calm.change < calm.high < 0
    assert broken.change == pytest.approx(-0.2, abs=2e-3)
    assert (calm.better, broken.better, broken.runs) == (12, 11, 12)
    assert (calm.score, calm.clean) == (pytest.approx(-0.2), pytest.approx(-0.1))


def test_runs_that_only_one_setting_has_or_that_give_no_error_are_left_out() -> None:
    found = judged(OUTCOME, row(None), NOMINAL, {0: 0.5 * NOMINAL[0], 1: math.nan, 99: 1.0}, is_adopted=False)

    assert (found.runs, found.better) == (1, 1)
    assert math.isnan(found.change)
    assert math.isnan(found.score)


def test_the_sentence_names_what_is_worse_and_is_empty_where_nothing_was_adopted() -> None:
    good, bad = candidate([0.8] * 11 + [0.81]), candidate([1.1] * 11 + [1.12])

    assert "1 of the 2 adopted settings have a larger true ATE than nominal (dtu-scan24.huber.s2 +10" in fresh_sentence(
        [good, bad]
    )
    assert "1 intervals lie below zero" in fresh_sentence([good, bad])
    assert fresh_sentence([judged(OUTCOME, row(), NOMINAL, NOMINAL, is_adopted=False)]) == ""


def test_the_table_has_a_row_for_each_candidate_and_can_be_read_back(tmp_path: Path) -> None:
    found = [candidate([0.8] * 12), judged(OUTCOME, row(None), NOMINAL, {}, is_adopted=False)]
    file = tmp_path / "results.json"
    plain = [
        {name: None if isinstance(value, float) and math.isnan(value) else value for name, value in asdict(one).items()}
        for one in found
    ]
    file.write_text(json.dumps({"fresh": plain}))

    assert [line[2] for line in fresh_table(found)[1]] == ["**adopt**", ""]
    assert fresh_table(stored_fresh(file)) == fresh_table(found)
