import math
from dataclasses import replace

import plotly.graph_objects as go
import pytest

from gtf_tune.display import sequence_unit
from gtf_tune.report.drawing import theme
from gtf_tune.report.drawing.axes import searched_axes, shortened, trial_text
from gtf_tune.report.panels.matrices import matrix_figure
from gtf_tune.report.panels.options import option_curve, option_figure, recommended_star
from gtf_tune.report.panels.search import (
    history_figure,
    importance_figure,
    infeasible_level,
    optuna_copy,
    parallel_figure,
)
from gtf_tune.report.points import TrialPoint, sequence_detail, study_points
from gtf_tune.report.study_data import StudyData, read_study
from gtf_tune.store.database import Database


def figure_of(data: StudyData, number: int = 0) -> go.Figure:
    points, axes = study_points(data), searched_axes(data)
    return option_figure(option_curve(points, axes[number], len(axes), recommended_star(data)), points)


def traces(figure: go.Figure) -> dict[str, go.Scatter]:
    return {trace.name: trace for trace in figure.data if trace.name}


def test_the_papers_figure_has_its_colours_and_axes(data: StudyData) -> None:
    figure = figure_of(data)

    shown = traces(figure)
    assert shown["GTF ATE"].marker.color == "rgb(187,136,187)"
    assert shown["true ATE"].marker.color == "rgb(54,161,101)"
    assert shown["nominal: 0.01"].marker.color == "rgb(27,107,162)"
    assert (shown["GTF ATE"].yaxis, shown["true ATE"].yaxis) == ("y", "y2")
    assert figure.layout.xaxis.type == "log"


def test_the_best_trial_and_the_least_true_error_are_marked_at_their_values(data: StudyData) -> None:
    shown = traces(figure_of(data))

    best = study_points(data).points[3]
    assert list(shown["best so far: 0.002"].y) == [best.value]
    assert list(shown["least true ATE: 0.002"].y) == [best.ground_truth]


def test_trials_without_a_value_stand_at_the_rim(data: StudyData) -> None:
    shown = traces(figure_of(data))

    assert set(shown["no value"].x) == {1e-5, 0.1}
    assert shown["no value"].yaxis == "y3"
    assert list(shown["stopped early"].x) == [0.02]


def test_a_study_of_one_option_has_an_interval_and_no_second_axis_without_ground_truth(database: Database) -> None:
    figure = figure_of(read_study(database, "single"))

    assert "95 % interval" in traces(figure)
    assert "true ATE" not in traces(figure)
    assert "yaxis2" not in figure.layout.to_plotly_json()


def test_categories_keep_their_words(data: StudyData) -> None:
    figure = figure_of(data, number=1)

    assert list(figure.layout.xaxis.ticktext) == ["trivial", "huber", "cauchy"]
    assert "nominal: huber" in traces(figure)


def test_optunas_figures_show_every_trial_under_its_number(data: StudyData) -> None:
    points = study_points(data)

    shown = traces(history_figure(optuna_copy(points, searched_axes(data)), points))

    assert list(shown["GTF ATE"].x) == [0, 1, 2, 3, 4, 7, 8]
    assert list(shown["infeasible"].x) == [6]
    assert list(shown["infeasible"].y) == [infeasible_level(points)]
    assert (list(shown["pruned"].x), list(shown["failed"].x)) == ([5], [9])


def test_infeasible_trials_lie_above_the_worst_feasible_one(data: StudyData) -> None:
    points = study_points(data)

    study = optuna_copy(points, searched_axes(data))

    worst = max(point.value for point in points.scored)
    assert study.trials[6].value == pytest.approx(1.1 * worst)
    assert study.best_trial.number == 3


def test_parallel_coordinates_name_options_in_full(data: StudyData) -> None:
    points, axes = study_points(data), searched_axes(data)

    figure = parallel_figure(optuna_copy(points, axes), points, ["filter.max_error", "a.very_long_option.with_a_name"])

    assert list(figure.layout.xaxis.ticktext) == ["GTF ATE", "a.very_long_option<br>.with_a_name", "filter.max_error"]


def test_importances_add_up_to_one(data: StudyData) -> None:
    figure = importance_figure(optuna_copy(study_points(data), searched_axes(data)))

    assert sum(figure.data[0].x) == pytest.approx(1)


def test_failed_pairs_are_named_in_the_matrix(data: StudyData) -> None:
    figure = matrix_figure(sequence_detail(data, 6, "walk"), sequence_unit(data.definition.gtf), (1.0, 10.0))

    heatmap = figure.data[0]
    assert heatmap.text[0][3] == "failed"
    assert "expected at least 4 matched frames" in heatmap.hovertext[0][3]


def test_a_collapsed_noisy_run_is_flagged(data: StudyData) -> None:
    detail = replace(sequence_detail(data, 0, "walk"), collapsed=(False, True, False, False))

    figure = matrix_figure(detail, sequence_unit(data.definition.gtf), (1.0, 10.0))

    assert list(figure.layout.xaxis.ticktext) == ["0", "1<br>collapsed", "2", "3"]


def test_texts_of_users_are_harmless_in_figures(data: StudyData) -> None:
    point = TrialPoint(4, "infeasible", message="<img src=x onerror=alert(1)>" + 200 * "x")

    text = trial_text(point, study_points(data))

    assert "<img" not in text
    assert len(shortened(200 * "x")) == 90


def test_a_title_is_added_without_touching_the_figure() -> None:
    figure = theme.figure(height=300)

    titled = theme.titled(figure, "name")

    assert (titled.layout.title.text, figure.layout.title.text) == ("name", None)
    assert titled.layout.height > 300
    assert math.isclose(titled.layout.margin.t, figure.layout.margin.t + 34)
