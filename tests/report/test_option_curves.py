import math

import pytest

from gtf_tune.definition import RangeAxis, ValuesAxis
from gtf_tune.display import ScoreUnit
from gtf_tune.report.drawing.axes import OptionAxis, option_axis, options_at_an_edge
from gtf_tune.report.panels.options import Star, option_curve
from gtf_tune.report.points import PointSet, TrialPoint

LOG = RangeAxis(low=1e-4, high=0.1, log=True)
UNIT = ScoreUnit("GTF ATE", 1000.0, "‰ of extent", "per mille of the extent")


def points_of(*points: TrialPoint) -> PointSet:
    return PointSet("walk", UNIT, "ground-truth ATE", points)


def test_a_curve_is_sorted_along_its_axis_and_has_the_best_trial_the_least_true_error_and_nominal() -> None:
    points = points_of(
        TrialPoint(0, "feasible", {"a": 0.01}, value=5.0, ground_truth=3.0),
        TrialPoint(1, "feasible", {"a": 0.001}, value=2.0, ground_truth=2.5),
        TrialPoint(2, "feasible", {"a": 0.003}, value=3.0, ground_truth=2.0),
    )

    curve = option_curve(points, option_axis("a", LOG), searched=1, star=Star(1, "adopted"))

    assert curve.places == (0.001, 0.003, 0.01)
    assert (curve.best, curve.best_ground_truth, curve.nominal) == (0, 1, 2)
    assert curve.line == (0, 1, 2)


def test_trials_without_a_value_are_outside_the_curve_and_stopped_ones_beside_it() -> None:
    points = points_of(
        TrialPoint(0, "feasible", {"a": 0.01}, value=5.0),
        TrialPoint(1, "infeasible", {"a": 0.02}),
        TrialPoint(2, "pruned", {"a": 0.03}, value=9.0),
        TrialPoint(3, "failed", {"a": 0.04}),
        TrialPoint(4, "running", {"a": 0.05}),
    )

    curve = option_curve(points, option_axis("a", LOG), searched=1)

    assert curve.places == (0.01,)
    assert [place for place, _ in curve.outside] == [0.02, 0.04]
    assert [place for place, _ in curve.stopped] == [0.03]


def test_no_line_connects_points_whose_other_options_differ() -> None:
    points = points_of(*(TrialPoint(n, "feasible", {"a": 0.01 + n / 100, "b": n}, value=n + 1.0) for n in range(6)))

    curve = option_curve(points, option_axis("a", LOG), searched=2)

    assert curve.line == ()


def test_a_line_connects_the_best_of_each_level_where_levels_repeat() -> None:
    values = [(0.01, 4.0), (0.01, 3.0), (0.02, 9.0), (0.02, 8.0)]
    points = points_of(*(TrialPoint(n, "feasible", {"a": a}, value=value) for n, (a, value) in enumerate(values)))

    curve = option_curve(points, option_axis("a", LOG), searched=2)

    assert [curve.points[index].value for index in curve.line] == [3.0, 8.0]


@pytest.mark.parametrize(
    ("axis", "expected"),
    [
        (LOG, OptionAxis("a", "log", 1e-4, 0.1)),
        (RangeAxis(low=1, high=9), OptionAxis("a", "linear", 1.0, 9.0)),
        (ValuesAxis(values=[0.001, 0.1]), OptionAxis("a", "log", 0.001, 0.1)),
        (ValuesAxis(values=[0.6, 0.8]), OptionAxis("a", "linear", 0.6, 0.8)),
        (ValuesAxis(values=[True, False]), OptionAxis("a", "categories", 0.0, 1.0, ("true", "false"))),
        (ValuesAxis(values=["x", "y"]), OptionAxis("a", "categories", 0.0, 1.0, ("x", "y"))),
    ],
)
def test_an_axis_is_drawn_as_it_is_searched(axis: RangeAxis | ValuesAxis, expected: OptionAxis) -> None:
    assert option_axis("a", axis) == expected


def test_an_axis_has_room_for_values_that_the_space_leaves_out() -> None:
    assert option_axis("a", LOG, [0.5]).high == 0.5
    assert option_axis("a", ValuesAxis(values=["x", "y"]), ["z"]).categories == ("z", "x", "y")


def test_a_category_lies_at_its_position() -> None:
    assert option_axis("a", ValuesAxis(values=["x", "y"])).place("y") == 1.0


def test_a_pick_at_an_end_of_its_range_is_named() -> None:
    space = {"a": LOG, "b": RangeAxis(low=0, high=1), "c": ValuesAxis(values=[1, 2])}

    assert options_at_an_edge(space, {"a": 1e-4, "b": 0.5, "c": 1}, {}) == ("a",)
    assert options_at_an_edge(space, {"a": 1.01e-4, "b": 1.0, "c": 2}, {}) == ("b",)
    assert options_at_an_edge(space, {"a": 1e-4, "b": 1.0}, {"a": 1e-4, "b": 0.5}) == ("b",)


def test_nothing_is_marked_where_nothing_is_scored() -> None:
    points = points_of(TrialPoint(0, "infeasible", {"a": 0.01}))

    curve = option_curve(points, option_axis("a", LOG), searched=1, star=Star(0, "kept"))

    assert (curve.best, curve.best_ground_truth, curve.nominal) == (None, None, None)


def test_a_study_without_ground_truth_has_no_best_against_it() -> None:
    points = points_of(TrialPoint(0, "feasible", {"a": 0.01}, value=5.0))

    assert not points.has_ground_truth
    assert math.isnan(points.scored[0].ground_truth)
