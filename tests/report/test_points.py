import math
from dataclasses import replace

import pytest

from gtf_tune.report.points import sequence_points, study_points
from gtf_tune.report.study_data import StudyData, read_study
from gtf_tune.store.database import Database
from gtf_tune.store.ground_truth_errors import Validation


def test_scores_of_one_sequence_are_shown_in_per_mille_of_the_extent(data: StudyData) -> None:
    stored = data.trials[3]

    point = study_points(data).points[3]

    assert stored.gtf_ate is not None
    assert point.value == pytest.approx(1000 * stored.gtf_ate)
    assert point.low < point.value < point.high
    assert study_points(data).unit.label == "GTF ATE [‰ of extent]"


def test_every_trial_says_how_it_ended(data: StudyData) -> None:
    states = {point.number: point.state for point in study_points(data).points}

    assert states[0] == "feasible"
    assert (states[6], states[5], states[9]) == ("infeasible", "pruned", "failed")


def test_an_infeasible_trial_has_no_value_although_optuna_was_told_a_penalty(data: StudyData) -> None:
    point = study_points(data).points[6]

    assert data.trials[6].value == 1.5
    assert math.isnan(point.value)
    assert not point.is_scored


def test_a_trial_that_was_stopped_early_keeps_its_value_but_may_not_be_picked(data: StudyData) -> None:
    point = study_points(data).points[5]

    assert math.isfinite(point.value)
    assert not point.is_scored


def test_ground_truth_and_reprojection_error_stand_beside_the_score(data: StudyData) -> None:
    point = study_points(data).points[0]

    assert point.ground_truth == data.validations[0][0].ate
    assert point.reprojection_px > 0.5


def test_several_sequences_are_combined_relative_to_nominal(database: Database) -> None:
    points = study_points(read_study(database, "two"))

    assert points.unit.label == "GTF ATE [relative to nominal]"
    assert points.points[0].value == pytest.approx(1)
    assert points.points[0].ground_truth == pytest.approx(1)


def test_combined_ground_truth_is_the_geometric_mean_of_ratios(database: Database) -> None:
    study = read_study(database, "two")
    errors = {0: (2.0, 8.0), 1: (4.0, 4.0), 2: (1.0, 2.0)}
    validations = {
        trial: [Validation("walk", first), Validation("room", second)] for trial, (first, second) in errors.items()
    }

    points = study_points(replace(study, validations=validations)).points

    assert [points[trial].ground_truth for trial in errors] == pytest.approx([1.0, 1.0, math.sqrt(0.5 * 0.25)])


def test_each_of_several_sequences_has_its_own_scores(database: Database) -> None:
    study = read_study(database, "two")

    walk, room = (sequence_points(study, name).points[1] for name in ("walk", "room"))

    assert walk.value != room.value
    assert walk.ground_truth == study.validations[1][1].ate
