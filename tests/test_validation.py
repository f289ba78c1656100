import numpy as np
import pytest

from gtf_tune.definition import SideMetricDefinition
from gtf_tune.errors import TrajectoryError
from gtf_tune.study.ground_truth.record import side_metric
from gtf_tune.trajectory import Trajectory

COUNT = 12


def _walk(scale: float = 1.0, shift: float = 0.0, turn_deg: float = 0.0) -> Trajectory:
    """Return a bent walk, scaled and shifted, whose cameras turn a little more from frame to frame."""
    along = np.arange(COUNT, dtype=np.float64)
    halves = np.radians(turn_deg * along) / 2
    return Trajectory(
        frame_ids=np.arange(COUNT),
        timestamps=along / 10,
        positions=scale * np.column_stack([along, np.sin(along), np.cos(along)]) + shift,
        quaternions=np.column_stack([np.zeros(COUNT), np.zeros(COUNT), np.sin(halves), np.cos(halves)]),
    )


def test_a_scaled_run_is_right_only_where_scale_is_free() -> None:
    errors = {
        kind: side_metric(_walk(), [_walk(scale=1.1)], SideMetricDefinition(alignment=kind)).value
        for kind in ("sim3", "se3", "none")
    }

    assert errors["sim3"] == pytest.approx(0.0, abs=1e-9)
    assert 0.1 < errors["se3"] < errors["none"]


def test_without_alignment_a_shift_counts() -> None:
    found = side_metric(_walk(), [_walk(shift=2.0)], SideMetricDefinition(alignment="none"))

    assert found.value == pytest.approx(2 * np.sqrt(3))


def test_rotation_errors_are_degrees_over_the_delta() -> None:
    definition = SideMetricDefinition(metric="rpe_rotation", rpe_delta=3)

    assert side_metric(_walk(), [_walk(turn_deg=0.5)], definition).value == pytest.approx(1.5)
    assert (definition.words, definition.unit) == ("rotation RPE over 3 frames", "deg")


def test_translation_errors_over_seconds_are_those_over_as_many_frames() -> None:
    by_time = SideMetricDefinition(metric="rpe_translation", rpe_delta=0.2, rpe_delta_unit="seconds", alignment="se3")
    by_count = SideMetricDefinition(metric="rpe_translation", rpe_delta=2, alignment="se3")
    errors = [side_metric(_walk(), [_walk(scale=1.1)], one).value for one in (by_time, by_count)]

    assert errors[0] == pytest.approx(errors[1])
    assert by_time.words == "RPE over 0.2 s, SE(3)"


def test_runs_that_cannot_be_compared_are_left_out_with_their_reason() -> None:
    short = _walk().select(np.arange(COUNT) < 3)

    found = side_metric(_walk(), [_walk(), short])

    assert len(found.by_run) == len(found.skipped) == 1
    with pytest.raises(TrajectoryError, match="no run can be compared"):
        side_metric(_walk(), [short])
