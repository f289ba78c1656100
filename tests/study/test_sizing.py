from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from gtf_tune.definition import StudyDefinition, definition_from_dict
from gtf_tune.study.scoring.early_stopping import (
    PRUNER_FIRST,
    AdaptiveSizing,
    FixedSizing,
    PrunerSizing,
    Sizing,
    sizing_of,
)
from tests.study.conftest import definition_of

ADAPTIVE = AdaptiveSizing(least=3, most=12)
INCUMBENT = [1.0, 1.2, 0.8, 1.1, 0.9, 1.0, 1.3, 0.7, 1.0, 1.1, 0.9, 1.0]


def _definition(gtf: dict[str, object], **search: object) -> StudyDefinition:
    return definition_from_dict(definition_of(Path("room"), gtf=gtf, search=search))


def _own(factor: float, count: int) -> list[float]:
    return [factor * value for value in INCUMBENT[:count]]


@pytest.mark.parametrize(
    ("gtf", "search", "expected"),
    [
        ({"noisy_runs": 6}, {}, FixedSizing(6)),
        ({"noisy_runs": {"min": 3, "max": 12}, "aggregate": "median"}, {}, AdaptiveSizing(3, 12, "median")),
        ({"noisy_runs": {"min": 5, "max": 5}}, {}, FixedSizing(5)),
        ({"noisy_runs": 10}, {"pruner": "wilcoxon"}, PrunerSizing(10)),
    ],
)
def test_the_definition_chooses_the_sizing(gtf: dict[str, object], search: dict[str, object], expected: Sizing) -> None:
    assert sizing_of(_definition(gtf, **search)) == expected


def test_fixed_sizing_gives_every_trial_k_delta() -> None:
    sizing = FixedSizing(6)

    assert sizing.first(is_nominal=True) == sizing.first(is_nominal=False) == 6
    assert sizing.next(_own(9.0, 6), INCUMBENT).noisy_runs == 6


def test_nominal_gets_all_runs_and_others_start_small() -> None:
    assert ADAPTIVE.first(is_nominal=True) == 12
    assert ADAPTIVE.first(is_nominal=False) == 3


def test_a_hopeless_trial_stops_at_once() -> None:
    decision = ADAPTIVE.next(_own(1.6, 3), INCUMBENT)

    assert (decision.noisy_runs, decision.hopeless) == (3, True)
    assert "60 % worse" in decision.reason


def test_a_trial_that_competes_gets_more_runs() -> None:
    decision = ADAPTIVE.next(_own(1.02, 3), INCUMBENT)

    assert (decision.noisy_runs, decision.hopeless) == (6, False)


@pytest.mark.parametrize("incumbent", [INCUMBENT, []])
def test_a_trial_that_may_become_the_incumbent_is_measured_in_full(incumbent: list[float]) -> None:
    decision = ADAPTIVE.next(_own(0.5, 3), incumbent)

    assert (decision.noisy_runs, decision.hopeless) == (12, False)


def test_no_trial_gets_more_than_the_most() -> None:
    assert AdaptiveSizing(3, 11).next(_own(1.0, 9), INCUMBENT).noisy_runs == 11


def test_a_trial_with_all_runs_is_never_hopeless() -> None:
    assert not ADAPTIVE.next(_own(5.0, 12), INCUMBENT).hopeless


def test_an_infeasible_trial_gets_no_more_runs() -> None:
    for sizing in (ADAPTIVE, FixedSizing(6), PrunerSizing(10)):
        decision = sizing.next([], INCUMBENT)

        assert (decision.noisy_runs, decision.hopeless) == (0, False)


def test_a_mean_that_perfect_runs_cannot_save_is_given_up() -> None:
    own = [0.9, 0.9, 50.0]

    by_mean = AdaptiveSizing(3, 12, "mean").next(own, INCUMBENT)
    by_median = AdaptiveSizing(3, 12, "median").next(own, INCUMBENT)

    assert by_mean.hopeless
    assert "cannot beat" in by_mean.reason
    assert not by_median.hopeless


def test_a_shorter_incumbent_is_compared_as_far_as_it_goes() -> None:
    assert ADAPTIVE.next(_own(1.6, 6), INCUMBENT[:4]).hopeless


values = st.lists(st.floats(1e-3, 10.0), min_size=1, max_size=12)


@given(values, st.lists(st.floats(1e-3, 10.0), max_size=12), st.sampled_from(["mean", "median", "gmean", "trimmed"]))
def test_decisions_follow_from_the_values_alone_and_stay_in_bounds(
    own: list[float], incumbent: list[float], aggregate: str
) -> None:
    sizing = AdaptiveSizing(3, 12, aggregate)  # type: ignore[arg-type]

    decision = sizing.next(own, incumbent)

    assert decision == sizing.next(tuple(own), tuple(incumbent))
    assert len(own) <= decision.noisy_runs <= 12
    assert decision.noisy_runs == len(own) or not decision.hopeless


def test_the_pruner_is_asked_between_small_steps() -> None:
    sizing = PrunerSizing(9)
    counts = [sizing.first(is_nominal=False)]
    while (following := sizing.next(_own(1.0, counts[-1]), INCUMBENT).noisy_runs) > counts[-1]:
        counts.append(following)

    assert counts == [PRUNER_FIRST, 8, 9]
