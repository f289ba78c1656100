import math
from pathlib import Path

import pytest

from gtf_tune.errors import DefinitionError
from gtf_tune.report.drawing import theme
from gtf_tune.report.noise_page import draw_score, draw_squares, write_noise_page
from gtf_tune.study.noise.choice import NoiseLevel
from gtf_tune.study.noise.ladder import NoiseScale, noise_scale

RESPONSE = 1e-3


@pytest.fixture
def scale() -> NoiseScale:
    sound = [NoiseLevel(sigma, RESPONSE * sigma, 0.3, runs=4) for sigma in (0.5, 1.0, 2.0)]
    return noise_scale(NoiseLevel(0.0, 0.0, math.nan, runs=4), [*sound, NoiseLevel(5.0, 0.2, 2.0, 4, collapsed=1)])


def test_the_score_is_drawn_in_per_mille_with_the_fitted_line(scale: NoiseScale) -> None:
    points, line = draw_score(scale).data

    assert list(points.y) == pytest.approx([0.0, 0.5, 1.0, 2.0, 200.0])
    assert list(line.x) == [0.0, 2.0]
    assert list(line.y) == pytest.approx([0.0, 2.0], abs=1e-9)


def test_levels_with_collapsed_runs_are_red(scale: NoiseScale) -> None:
    points, _ = draw_score(scale).data

    assert points.marker.color[-1] == theme.WRONG
    assert theme.WRONG not in points.marker.color[:-1]


def test_squares_are_drawn_in_the_linear_range_only(scale: NoiseScale) -> None:
    points, _ = draw_squares(scale).data

    assert list(points.x) == [0.0, 0.25, 1.0, 4.0]
    assert list(points.y) == pytest.approx([0.0, 0.25, 1.0, 4.0])


def test_the_page_holds_both_figures_and_the_recommendation(scale: NoiseScale, tmp_path: Path) -> None:
    write_noise_page(tmp_path / "noise.html", scale, "house", "glomap")

    page = (tmp_path / "noise.html").read_text(encoding="utf-8")
    assert 'id="noise-score"' in page
    assert 'id="noise-squares"' in page
    assert f"recommended sigma {scale.recommended:g} grey levels" in page


def test_a_folder_that_is_not_there_is_one_sentence(scale: NoiseScale, tmp_path: Path) -> None:
    with pytest.raises(DefinitionError, match="cannot be written"):
        write_noise_page(tmp_path / "missing" / "noise.html", scale, "house", "glomap")
