"""Sparse models before and after, in the same view."""

import json

import numpy as np
import pytest

from gtf_tune.pipelines.colmap.clouds import MOST_POINTS, SparseCloud
from gtf_tune.report.html import figure_json
from gtf_tune.report.panels.models import model_drawings, seen_alike
from gtf_tune.trajectory.alignment import Similarity

TURNED = np.array([[0.0, -1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, 1.0]])


def cloud(count: int = 200, images: int = 6) -> SparseCloud:
    """Return points before cameras that look along +z with y down."""
    generator = np.random.default_rng(0)
    rays = np.array([[-0.5, -0.4, 1.0], [0.5, -0.4, 1.0], [0.5, 0.4, 1.0], [-0.5, 0.4, 1.0]])
    return SparseCloud(
        points=generator.normal((0, 0, 5), 0.5, (count, 3)),
        colours=generator.integers(0, 256, (count, 3)),
        names=tuple(f"{number}.png" for number in range(images)),
        centres=generator.normal(0, 0.5, (images, 3)),
        corners=np.tile(rays, (images, 1, 1)),
        axes=np.tile(np.eye(3), (images, 1, 1)),
        num_points=count,
        error_px=0.4,
    )


def moved(model: SparseCloud, similarity: Similarity) -> SparseCloud:
    turned = model.corners @ similarity.rotation.T, model.axes @ similarity.rotation.T
    points, centres = similarity.apply(model.points), similarity.apply(model.centres)
    return SparseCloud(points, model.colours, model.names, centres, *turned, model.num_points, model.error_px)


def test_cameras_stand_upright_and_look_forward() -> None:
    (seen,) = seen_alike([cloud()])

    ahead = seen.points.mean(axis=0) - seen.cameras[:, 0].mean(axis=0)
    assert ahead[1] > 5 * np.abs(ahead[[0, 2]]).max()
    assert (seen.cameras[:, 1, 2] > seen.cameras[:, 0, 2]).all()  # the upper corner is above the centre
    assert (seen.cameras[:, 1, 0] < seen.cameras[:, 0, 0]).all()  # the left one is to the left


def test_the_second_model_is_laid_on_the_first() -> None:
    first = cloud()

    seen = seen_alike([first, moved(first, Similarity(3.0, TURNED, np.array([1.0, 2.0, 3.0])))])

    np.testing.assert_allclose(seen[1].points, seen[0].points, atol=1e-9)
    np.testing.assert_allclose(seen[1].cameras, seen[0].cameras, atol=1e-9)


def test_both_figures_show_the_same_part_of_space_and_stay_small() -> None:
    drawings = model_drawings({"nominal": cloud(MOST_POINTS, 60), "adopted": cloud(MOST_POINTS, 40)})

    scenes = [json.loads(figure_json(drawing.figure))["layout"]["scene"] for drawing in drawings]
    assert scenes[0] == scenes[1]
    assert sum(len(figure_json(drawing.figure)) for drawing in drawings) < 1_000_000
    assert drawings[0].title == "nominal: 60 images, 4,000 points, mean reprojection error 0.4 px"


@pytest.mark.parametrize("model", [cloud(count=0), cloud(images=1)], ids=["no points", "one camera"])
def test_poor_models_are_drawn_too(model: SparseCloud) -> None:
    assert len(model_drawings({"nominal": cloud(), "adopted": model})) == 2
