"""The page beside the paper says what was measured, and nothing else."""

from dataclasses import replace
from pathlib import Path

import numpy as np

from experiments.paper import figures
from experiments.paper.figures import Linearity
from experiments.paper.page import Paper, page, reason_lines, summary
from experiments.paper.plan import COLMAPS_HUBER, STANDINS, full_studies, light_studies, stands_for
from experiments.settings import Outcome
from gtf_tune.study.create import checked_definition
from tests.experiments.test_experiment_outcomes import setting

STUDIES = light_studies(Path("images"))
OFFICE_HUBER = next(study for study in STUDIES if study.option.short == "huber" and study.sequence == "office")


def outcome(true_ates: dict[float, float], scores: dict[float, float]) -> Outcome:
    """Return a grid over the Huber loss: true ATE and score by value, nominal first."""
    settings = tuple(
        replace(
            setting(number, true_ate),
            value=value,
            matrix=np.full((1, 3), scores[value]),
            true_ate=true_ate,
        )
        for number, (value, true_ate) in enumerate(true_ates.items())
    )
    return Outcome(OFFICE_HUBER, settings, None, "unconfirmed")


FOUND = outcome({0.1: 2.0, 0.3: 1.5, COLMAPS_HUBER: 4.0}, {0.1: 0.2, 0.3: 0.1, COLMAPS_HUBER: 0.4})
PAPER = Paper([FOUND], STUDIES, None, is_light=True)


def test_every_light_study_is_a_valid_definition_with_a_name_of_its_own() -> None:
    for study in STUDIES:
        definition = checked_definition(study.data, study.study)
        assert definition.pipeline.nominal == {"mapper.bundle_adjustment.ceres.loss_function_scale": 0.1}
    assert len({study.study for study in STUDIES}) == len(STUDIES)


def test_each_stand_in_stands_for_one_row_of_the_papers_table() -> None:
    assert [stands_for(name, "TartanAir ME001") for name in STANDINS] == [False, True, False]
    assert stands_for("eth3d-table3", "ETH3D table_3")


def test_the_page_puts_changes_beside_the_papers_and_says_what_is_missing() -> None:
    text = page(PAPER, [])

    assert "| here: office | 2 | not yet | -25.0% (-25.0%) | not yet | not yet | not yet |" in text
    assert f"1 of {len(STUDIES)} studies are measured" in text
    assert "| paper: Replica office0 | 1.35 mm |" in text


def test_means_of_the_paper_follow_from_its_table() -> None:
    assert summary(PAPER).startswith("The paper improves 14 of 15, by 26 % of 32 % on average.")
    assert "Here 1 of 1 improve and 0 are worse; -25.0% of -25.0% on average" in summary(PAPER)
    assert "nothing is measured yet" in summary(replace(PAPER, outcomes=[]))


def test_the_gain_on_huber_is_split_into_the_return_to_the_papers_default_and_the_rest() -> None:
    baseline = reason_lines(PAPER)[0]

    assert "the picks change the true ATE by -62.5% on average over 1 sequences" in baseline
    assert "0.1 alone does so by -50.0%" in baseline


def test_linearity_is_drawn_with_the_line_through_the_first_three_levels() -> None:
    found = Linearity(np.array([0.0, 1.0, 2.0, 5.0]), np.zeros(4), np.array([1.0, 2.0, 3.0, 30.0]))

    assert np.allclose(found.line, (1.0, 1.0))
    dots, line = figures.linearity(found).data
    assert list(dots.y) == [1.0, 2.0, 3.0, 30.0]
    assert np.allclose(line.y, [1.0, 6.0])


def test_figures_without_data_draw_nothing() -> None:
    drawn = [figures.linearity(None), figures.noise([]), figures.k_delta([]), figures.regressions([])]

    assert [len(figure.data) for figure in drawn] == [0, 0, 0, 0]


def test_regressions_are_relative_to_nominal_over_the_option() -> None:
    over_option = figures.regressions([FOUND]).data[0]

    assert list(over_option.x) == [0.1, 0.3, 1.0]
    assert np.allclose(over_option.y, [1.0, 0.75, 2.0])


def test_with_data_the_papers_own_studies_are_taken_with_thinner_grids(tmp_path: Path) -> None:
    (tmp_path / "Replica" / "office0").mkdir(parents=True)

    found = full_studies(tmp_path, 5)

    assert {study.sequence for study in found} == {"replica-office0"}
    assert {study.figure for study in found} == {"table", "noise", "k-delta", "ablation"}
    (axis,) = found[-1].data["space"].values()
    assert axis["points"] == 5
    assert found[0].data["sequences"][0]["path"] == str(tmp_path / "Replica" / "office0")
