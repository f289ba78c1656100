import math
from typing import Any

import numpy as np
import optuna
import pytest
from optuna.distributions import CategoricalDistribution, FloatDistribution, IntDistribution
from scipy.optimize import check_grad

from gtf_tune.study.search.refine import Axis
from gtf_tune.study.search.refine_many import MOST_POINTS, Choices, RefineManySampler, Space, coarse_points
from gtf_tune.study.search.surface import _Likelihood, _squares, fit_surface, next_point

SPACE = {
    "error": FloatDistribution(1e-4, 1e-1, log=True),
    "length": IntDistribution(2, 8),
    "kernel": CategoricalDistribution(("huber", "cauchy", "trivial")),
    "ratio": CategoricalDistribution((0.9, 0.6, 0.8)),
}


def _search(trials: int, *, study: optuna.Study | None = None) -> optuna.Study:
    study = study or optuna.create_study()
    while len(study.trials) < trials:
        study.sampler = RefineManySampler(SPACE, 1, len(study.trials))
        trial = study.ask(SPACE)
        study.tell(trial, _score(trial.params))
    return study


def _score(options: dict[str, Any]) -> float:
    cost = (math.log10(options["error"]) + 2.6) ** 2 + 0.05 * (options["length"] - 5) ** 2
    return 1e-3 * math.exp(cost + (options["kernel"] != "cauchy") + 4 * abs(options["ratio"] - 0.8))


def test_the_search_comes_close_to_the_best_setting_of_four_kinds_of_options() -> None:
    best = _search(30).best_trial

    assert best.value == pytest.approx(1e-3, rel=0.1)
    assert (best.params["kernel"], best.params["ratio"]) == ("cauchy", 0.8)


def test_a_resumed_search_makes_the_same_suggestions() -> None:
    whole = _search(14)
    resumed = optuna.create_study()
    resumed.add_trials(whole.trials[:9])

    _search(14, study=resumed)

    assert [one.params for one in resumed.trials] == [one.params for one in whole.trials]


def test_trials_in_work_elsewhere_are_not_suggested_again() -> None:
    study = _search(10)
    study.sampler = RefineManySampler(SPACE, 1, 10)

    first, second = study.ask(SPACE), study.ask(SPACE)

    assert first.params != second.params


@pytest.mark.parametrize("missing", range(8))
def test_the_surface_tries_every_setting_before_it_repeats_one(missing: int) -> None:
    snap = Space(("length", "kernel"), (Axis(IntDistribution(2, 5)), Choices(CategoricalDistribution(("a", "b"))))).snap
    points = snap(np.array([[length / 3, kernel] for length in range(4) for kernel in (0.0, 1.0)]))
    known = np.delete(points, missing, axis=0)
    surface = fit_surface(known, np.arange(7.0), np.array([False, True]))

    assert next_point(surface, 0, snap).tolist() == points[missing].tolist()


def test_an_infeasible_region_is_left() -> None:
    study = optuna.create_study()
    for number in range(25):
        study.sampler = RefineManySampler(SPACE, 1, number)
        trial = study.ask(SPACE)
        trial.set_constraint("coverage", 0.5 if trial.params["error"] < 1e-2 else -0.1)
        study.tell(trial, 1.5 if trial.params["error"] < 1e-2 else _score(trial.params))

    late = [one.params["error"] for one in study.trials[12:]]
    assert sum(error >= 1e-2 for error in late) > 0.6 * len(late)
    assert study.best_trial.params["error"] < 2e-2


def test_old_trials_beyond_the_cap_are_left_out_of_the_surface() -> None:
    study = _search(coarse_points(len(SPACE)) + 2)
    study.add_trials([study.trials[3]] * (2 * MOST_POINTS))
    study.sampler = RefineManySampler(SPACE, 1, 5)

    assert SPACE["error"]._contains(study.ask(SPACE).params["error"])


def test_numbers_in_a_list_are_placed_by_their_order_and_words_are_not() -> None:
    numbers, words = Choices(CategoricalDistribution((0.9, 0.6, 0.8))), Choices(CategoricalDistribution(("b", "a")))

    assert sorted([0.9, 0.6, 0.8], key=numbers.place) == [0.6, 0.8, 0.9]
    assert (numbers.has_order, words.has_order) == (True, False)
    assert [words.value(words.place(one)) for one in ("a", "b")] == ["a", "b"]
    assert not Choices(CategoricalDistribution((True, False))).has_order


def test_the_gradient_of_the_likelihood_is_that_of_its_value() -> None:
    generator = np.random.default_rng(0)
    points = np.column_stack([generator.random((12, 2)), generator.integers(3, size=12) / 3])
    likelihood = _Likelihood(_squares(points, points, np.array([False, False, True])), generator.standard_normal(12))
    at = np.log([0.4, 0.9, 1.2, 0.1])

    error = check_grad(lambda x: likelihood.cost(x)[0], lambda x: likelihood.cost(x)[1], at)

    assert error < 1e-4


def test_the_next_point_lies_where_the_surface_falls() -> None:
    generator = np.random.default_rng(1)
    points = generator.random((25, 2))
    values = ((points - 0.3) ** 2).sum(axis=1)
    surface = fit_surface(points, values, np.array([False, False]))

    assert next_point(surface, 0, lambda one: one) == pytest.approx([0.3, 0.3], abs=0.1)
