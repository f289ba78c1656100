"""Stages are timed without the stages that they wait for."""

import pytest

from gtf_tune.pipelines.stage_clock import StageClock


@pytest.fixture
def clock() -> StageClock:
    """Return a clock on which a second passes between any two looks at the time."""
    times = iter(range(100))
    return StageClock(now=lambda: float(next(times)))


def test_inner_stages_count_for_themselves(clock: StageClock) -> None:
    with clock.timing("outer"):
        with clock.timing("inner"):
            pass
        with clock.timing("inner"):
            pass

    assert clock.seconds == {"inner": 2.0, "outer": 3.0}


def test_stages_that_were_not_built_were_cached(clock: StageClock) -> None:
    with clock.timing("matches"), clock.timing("mapping"):
        pass

    assert clock.diagnostics(["features", "matches"], always_run=["mapping"]) == {
        "features_s": 0.0,
        "features_cached": True,
        "matches_s": 2.0,
        "matches_cached": False,
        "mapping_s": 1.0,
    }


def test_failed_stages_are_timed_too(clock: StageClock) -> None:
    with pytest.raises(KeyError), clock.timing("mapping"):
        raise KeyError

    assert clock.seconds == {"mapping": 1.0}
