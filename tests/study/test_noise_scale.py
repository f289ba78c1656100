import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

from gtf_tune.errors import TrajectoryError
from gtf_tune.study.noise.choice import NoiseLevel
from gtf_tune.study.noise.ladder import noise_scale

SIGMAS = (0.5, 1.0, 2.0, 3.0, 5.0, 8.0)


def level(sigma: float, score: float, spread: float = 0.3, **faults: int) -> NoiseLevel:
    return NoiseLevel(sigma, score, spread, runs=4, **faults)


def ladder(floor: float, response: float) -> list[NoiseLevel]:
    return [level(sigma, math.hypot(floor, response * sigma)) for sigma in SIGMAS]


@given(st.floats(1e-6, 1e-3), st.floats(1e-5, 1e-2))
def test_a_linear_response_is_recovered_whatever_the_floor(floor: float, response: float) -> None:
    scale = noise_scale(level(0.0, floor), ladder(floor, response))

    known = [found for found in scale.responses if math.isfinite(found)]
    assert known == pytest.approx([response] * len(known), rel=1e-6)
    if sum(scale.linear) > 1:
        assert scale.square_line.r_squared == pytest.approx(1.0)
        assert scale.square_line.slope == pytest.approx(response**2, rel=1e-6)


def test_one_level_in_the_linear_range_does_not_show_that_it_is_linear() -> None:
    levels = [level(0.5, 1e-3), level(1.0, 1.1e-3), level(2.0, 1.2e-3)]

    scale = noise_scale(level(0.0, 1e-4), levels)

    assert scale.linear == (True, False, False)
    assert scale.score_line.slope == pytest.approx((1e-3 - 1e-4) / 0.5)
    assert math.isnan(scale.score_line.r_squared)
    assert math.isnan(scale.square_line.r_squared)


def test_noise_below_the_floor_is_not_in_the_linear_range() -> None:
    scale = noise_scale(level(0.0, 1e-3), ladder(1e-3, 1e-3))

    assert scale.linear == (False, False, True, True, True, True)


def test_the_linear_range_ends_where_the_response_grows() -> None:
    levels = ladder(1e-4, 1e-3)
    levels[4] = level(5.0, 0.02)

    assert noise_scale(level(0.0, 1e-4), levels).linear == (True, True, True, True, False, False)


@pytest.mark.parametrize("fault", ["collapsed", "failed"])
def test_nothing_from_the_first_broken_run_on_is_recommended(fault: str) -> None:
    levels = ladder(1e-4, 1e-3)
    levels[2] = level(2.0, 2e-3, spread=0.01, **{fault: 1})

    scale = noise_scale(level(0.0, 1e-4), levels)

    assert scale.linear == (True, True, False, False, False, False)
    assert scale.recommended in (0.5, 1.0)


def test_bad_luck_under_the_weakest_noise_does_not_end_the_linear_range() -> None:
    levels = ladder(1e-4, 1e-3)
    levels[0] = level(0.5, 5e-4, collapsed=1)

    scale = noise_scale(level(0.0, 1e-4), levels)

    assert scale.linear == (False, True, True, True, True, True)
    assert scale.recommended == 1.0


def test_the_best_ratio_of_signal_to_spread_is_recommended() -> None:
    levels = [level(one.sigma, one.score, spread=0.1 if one.sigma == 3.0 else 0.5) for one in ladder(1e-4, 1e-3)]

    assert noise_scale(level(0.0, 1e-4), levels).recommended == 3.0


def test_of_levels_with_the_same_ratio_the_weakest_is_recommended() -> None:
    assert noise_scale(level(0.0, 0.0), ladder(0.0, 1e-3)).recommended == 0.5


def test_noise_that_never_shows_is_recommended_at_its_strongest() -> None:
    scale = noise_scale(level(0.0, 1e-2), ladder(1e-2, 1e-5))

    assert scale.recommended == 8.0
    assert "does not show" in scale.reason


def test_a_ladder_that_breaks_on_its_first_step_recommends_nothing() -> None:
    with pytest.raises(TrajectoryError, match="no level of noise leaves every run intact"):
        noise_scale(level(0.0, 1e-4), [level(0.5, math.nan, failed=4)])


def test_a_floor_of_clean_runs_that_fell_apart_hides_no_noise() -> None:
    levels = [level(0.5, 1.5e-3), level(1.0, 6e-3, 2.7, collapsed=1), level(2.0, 1.9e-3), level(5.0, 3e-3)]

    scale = noise_scale(level(0.0, 0.4), levels)

    assert scale.recommended == 0.5
    assert "most of them fell apart" in scale.reason
    assert scale.floor.score == 0.4


def test_noise_that_does_not_show_above_run_to_run_differences_does_not_contradict_them() -> None:
    levels = [level(sigma, 1e-3) for sigma in (0.5, 1.0, 2.0)]

    scale = noise_scale(level(0.0, 1.2e-3), levels)

    assert scale.recommended == 2.0
    assert "fell apart" not in scale.reason
