from collections.abc import Mapping

import optuna
import pytest
from optuna.distributions import BaseDistribution, CategoricalDistribution, FloatDistribution, IntDistribution
from optuna.samplers import QMCSampler

from gtf_tune.study.search.qmc import NumberedPointsSampler

SPACE: Mapping[str, BaseDistribution] = {
    "float": FloatDistribution(-1.0, 3.0),
    "log": FloatDistribution(3e-4, 0.1, log=True),
    "stepped": FloatDistribution(0.0, 1.0, step=0.25),
    "int": IntDistribution(2, 20),
    "even": IntDistribution(2, 20, step=3),
    "int_log": IntDistribution(1, 1000, log=True),
    "word": CategoricalDistribution(("trivial", "huber", "cauchy")),
    "switch": CategoricalDistribution((True, False)),
}


def test_points_are_those_of_optuna_drawn_in_order() -> None:
    theirs = optuna.create_study(sampler=QMCSampler(seed=1, warn_independent_sampling=False))
    theirs.enqueue_trial({name: one.low if hasattr(one, "low") else one.choices[0] for name, one in SPACE.items()})
    theirs.tell(theirs.ask(dict(SPACE)), 0.0)

    expected = [theirs.ask(dict(SPACE)).params for _ in range(40)]

    for number, point in enumerate(expected):
        assert _drawn(number) == {
            name: pytest.approx(value, rel=1e-12) if isinstance(value, float) else value
            for name, value in point.items()
        }


def test_a_trial_gets_its_point_whatever_was_drawn_before() -> None:
    assert [_drawn(number)["float"] for number in (2, 1, 0, 1)] == [2.0, 1.0, -1.0, 1.0]


def _drawn(number: int) -> Mapping[str, object]:
    study = optuna.create_study(sampler=NumberedPointsSampler(SPACE, number))
    return study.ask(dict(SPACE)).params
