import math

import numpy as np
import optuna
import pytest
from hypothesis import given
from hypothesis import strategies as st
from optuna.distributions import CategoricalDistribution, FloatDistribution, IntDistribution
from optuna.trial import TrialState, create_trial

from gtf_tune.study.search.curve import fit_curve, next_place
from gtf_tune.study.search.refine import COARSE, Axis, RefineSampler

LOG = FloatDistribution(1e-4, 1e-1, log=True)
EVERYWHERE = np.linspace(0.0, 1.0, 101)


def _study(*trials: optuna.trial.FrozenTrial) -> optuna.Study:
    study = optuna.create_study(sampler=RefineSampler(nominal=1e-2))
    study.add_trials(list(trials))
    return study


def _trial(value: float, score: float, *, violation: float = 0.0) -> optuna.trial.FrozenTrial:
    return create_trial(
        value=score,
        params={"x": value},
        distributions={"x": LOG},
        constraints={"coverage": violation},
    )


def _suggest(study: optuna.Study) -> float:
    return study.ask().suggest_float("x", LOG.low, LOG.high, log=True)


def _bowl(value: float) -> float:
    return 1e-3 * math.exp((math.log10(value) + 2.6) ** 2)


@given(st.floats(0.0, 1.0))
def test_places_and_values_of_a_log_axis_are_inverse(place: float) -> None:
    axis = Axis(LOG)

    assert axis.place(axis.value(place)) == pytest.approx(place, abs=1e-6)
    assert LOG.low <= axis.value(place) <= LOG.high


def test_ends_of_an_axis_are_its_bounds() -> None:
    for distribution in (LOG, FloatDistribution(-3.0, 2.0), IntDistribution(2, 9), IntDistribution(1, 100, log=True)):
        axis = Axis.of(distribution)

        assert (axis.value(0.0), axis.value(1.0)) == (distribution.low, distribution.high)


def test_a_stepped_axis_gives_multiples_of_its_step() -> None:
    axis = Axis(FloatDistribution(0.5, 0.9, step=0.1))

    assert [axis.value(place) for place in (0.0, 0.3, 0.6, 1.0)] == [0.5, 0.6, 0.7, 0.9]


def test_whole_numbers_are_tried_once_as_long_as_there_are_new_ones() -> None:
    axis = Axis(IntDistribution(2, 6))
    tried = np.array([axis.place(value) for value in (2, 4, 5)])

    assert [axis.value(place) for place in axis.candidates(tried).tolist()] == [3, 6]
    assert len(axis.candidates(np.array([axis.place(value) for value in range(2, 7)]))) == 5


def test_a_list_of_words_is_refused() -> None:
    with pytest.raises(TypeError, match="numbers"):
        Axis.of(CategoricalDistribution(["a", "b"]))


def test_a_curve_passes_near_its_points_and_is_unsure_far_from_them() -> None:
    places = np.array([0.1, 0.2, 0.3, 0.4])
    values = np.sin(3.0 * places)

    curve = fit_curve(places, values)

    assert curve.mean(places) == pytest.approx(values, abs=0.02)
    assert curve.deviation(np.array([1.0]))[0] > 5 * curve.deviation(places).max()


def test_the_next_place_lies_near_the_bottom_of_a_bowl() -> None:
    places = np.array([0.0, 0.25, 0.5, 0.75, 1.0])

    found = next_place(fit_curve(places, (places - 0.4) ** 2), EVERYWHERE)

    assert found == pytest.approx(0.4, abs=0.1)


@given(st.lists(st.floats(0.0, 1.0), min_size=1, max_size=12), st.integers(0, 99))
def test_any_points_give_a_place_among_the_candidates(places: list[float], seed: int) -> None:
    values = np.random.default_rng(seed).normal(size=len(places))

    assert next_place(fit_curve(np.array(places), values), EVERYWHERE) in EVERYWHERE


def test_equal_values_everywhere_give_a_place_among_the_candidates() -> None:
    assert next_place(fit_curve(np.array([0.2, 0.8]), np.zeros(2)), EVERYWHERE) in EVERYWHERE


def test_the_first_steps_are_even() -> None:
    study = _study(_trial(1e-2, 1.0))

    steps = []
    for _ in range(COARSE):
        trial = study.ask()
        steps.append(math.log10(trial.suggest_float("x", LOG.low, LOG.high, log=True)))
        study.tell(trial, 1.0)

    assert steps == pytest.approx([-3.25, -2.5, -1.75])


@pytest.mark.parametrize(
    ("distribution", "nominal", "expected"),
    [
        (FloatDistribution(1e-2, 1e2, log=True), 1.0, [0.1, 10.0]),
        (FloatDistribution(0.5, 0.9, step=0.1), 0.8, [0.6, 0.7]),
        (IntDistribution(2, 3), 3, [2]),
        (IntDistribution(2, 6), 2, [3, 4, 5]),
    ],
)
def test_no_step_repeats_nominal_or_another_step(
    distribution: FloatDistribution | IntDistribution, nominal: float, expected: list[float]
) -> None:
    study = optuna.create_study(sampler=RefineSampler(nominal))
    study.enqueue_trial({"x": nominal})
    found = []
    for _ in range(1 + len(expected)):
        trial = study.ask({"x": distribution})
        found.append(trial.params["x"])
        study.tell(trial, 1.0)

    assert found == [nominal, *expected]


def test_the_optimum_of_a_bowl_is_found_in_eight_trials() -> None:
    study = _study(_trial(1e-2, _bowl(1e-2)))
    for _ in range(7):
        trial = study.ask()
        study.tell(trial, _bowl(trial.suggest_float("x", LOG.low, LOG.high, log=True)))

    assert study.best_value < 1.01e-3


def test_trials_that_an_earlier_version_stopped_count_as_the_worst_score() -> None:
    known = [_trial(value, _bowl(value)) for value in (3e-4, 3e-3, 3e-2)]
    stopped = create_trial(
        state=TrialState.PRUNED, value=1e-5, params={"x": 9e-2}, distributions={"x": LOG}, intermediate_values={0: 1e-5}
    )

    assert _suggest(_study(*known, stopped)) < 2e-2


def test_infeasible_ends_are_avoided() -> None:
    known = [_trial(value, 1e-3 * value**0.3) for value in (3e-3, 1e-2, 5e-2)]
    infeasible = [_trial(1e-3, 1.4, violation=0.4), _trial(3e-4, 1.8, violation=0.8)]

    assert _suggest(_study(*known, *infeasible)) > 1e-3


def test_workers_side_by_side_look_at_different_places() -> None:
    study = _study(*(_trial(value, _bowl(value)) for value in (1e-2, 3e-4, 3e-3, 3e-2)))

    first, second = _suggest(study), _suggest(study)

    assert abs(math.log(first / second)) > 0.01


def test_a_study_without_a_feasible_trial_is_searched_where_nothing_was_tried() -> None:
    tried = [1e-2, 3e-4, 3e-3, 3e-2]
    for _ in range(3):
        tried.append(_suggest(_study(*(_trial(value, 1.5, violation=0.5) for value in tried))))

    assert [math.log10(value) for value in tried[-3:]] == pytest.approx([-1.0, -3.02, -4.0], abs=0.02)
