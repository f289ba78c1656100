"""The split of GLOMAP's mapping gives the bits of the uninterrupted mapper, on synthetic matches without images."""

from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pycolmap
import pytest

from gtf_tune.pipelines.colmap.family import run_to_models
from gtf_tune.pipelines.colmap.positioning import SplitRefused, map_from_positions, positioning_options, store_positions

Change = Callable[[Any], None]


def synthesize(path: Path, frames: int = 10) -> Any:
    """Return an open database of noisy, verified matches of one camera that moves round 200 points."""
    pycolmap.set_random_seed(3)
    options = pycolmap.SyntheticDatasetOptions()
    options.num_rigs, options.num_cameras_per_rig, options.num_frames_per_rig = 1, 1, frames
    options.num_points3D = 200
    database = pycolmap.Database.open(path)
    model = pycolmap.synthesize_dataset(options, database)
    noise = pycolmap.SyntheticNoiseOptions()
    noise.point2D_stddev = 1.0
    pycolmap.synthesize_noise(noise, model, database)
    return database


@pytest.fixture
def database(tmp_path: Path) -> Iterator[Any]:
    opened = synthesize(tmp_path / "matches.db")
    yield opened
    opened.close()


def options_with(change: Change) -> Any:
    options = pycolmap.GlobalPipelineOptions()
    options.num_threads, options.random_seed = 1, 5
    change(options.mapper)
    return options


def poses(models: list[Any]) -> bytes:
    found = [model.images[one].cam_from_world().matrix() for model in models for one in sorted(model.reg_image_ids())]
    return np.array(found).tobytes()


def whole(options: Any, database: Any) -> list[Any]:
    return run_to_models(lambda manager: pycolmap.GlobalPipeline(options, database, manager))


def nothing(mapper: Any) -> None:
    del mapper


def strict(mapper: Any) -> None:
    mapper.max_normalized_reproj_error = 0.002


def very_strict(mapper: Any) -> None:
    mapper.max_normalized_reproj_error = 1e-4


def robust(mapper: Any) -> None:
    mapper.bundle_adjustment.ceres.loss_function_scale = 0.1
    mapper.bundle_adjustment.ceres.loss_function_type = pycolmap.LossFunctionType.CAUCHY


def fewer_rounds(mapper: Any) -> None:
    mapper.ba_num_iterations = 1
    mapper.skip_retriangulation = True


@pytest.mark.parametrize("change", [nothing, strict, very_strict, robust, fewer_rounds])
def test_resumed_mapping_equals_whole_mapping_to_the_bit(database: Any, tmp_path: Path, change: Change) -> None:
    store_positions(options_with(nothing), database, tmp_path)

    resumed = map_from_positions(options_with(change), database, tmp_path)

    expected = whole(options_with(change), database)
    assert poses(resumed) == poses(expected)
    assert [model.num_points3D() for model in resumed] == [model.num_points3D() for model in expected]


def test_strict_thresholds_change_the_result(database: Any) -> None:
    assert poses(whole(options_with(nothing), database)) != poses(whole(options_with(strict), database))


def test_options_are_left_as_they_were(database: Any, tmp_path: Path) -> None:
    options, untouched = options_with(strict), options_with(strict)

    store_positions(options, database, tmp_path)
    map_from_positions(options, database, tmp_path)

    assert str(options.todict()) == str(untouched.todict())


def test_several_components_are_mapped_in_one_piece(database: Any, tmp_path: Path) -> None:
    images = sorted(image.image_id for image in database.read_all_images())
    for first in images[:5]:
        for second in images[5:]:
            database.delete_inlier_matches(first, second)
            database.delete_two_view_geometry(first, second)
    store_positions(options_with(nothing), database, tmp_path)

    assert len(whole(options_with(nothing), database)) == 2
    with pytest.raises(SplitRefused):
        map_from_positions(options_with(nothing), database, tmp_path)


def test_positions_of_other_frames_are_refused(database: Any, tmp_path: Path) -> None:
    store_positions(options_with(nothing), database, tmp_path)
    other = synthesize(tmp_path / "other.db", frames=7)

    with pytest.raises(SplitRefused, match="other frames"):
        map_from_positions(options_with(nothing), other, tmp_path)

    other.close()


def test_nothing_is_stored_where_no_position_is_found(tmp_path: Path) -> None:
    empty = pycolmap.Database.open(tmp_path / "empty.db")

    store_positions(options_with(nothing), empty, tmp_path)

    assert not list(tmp_path.glob("*.npz"))
    empty.close()


def test_only_options_of_the_first_half_count() -> None:
    options = {
        "mapper.rotation_averaging.max_rotation_error_deg": 10.0,
        "mapper.max_angular_reproj_error_deg": 1.0,
        "mapper.max_normalized_reproj_error": 0.01,
        "mapper.bundle_adjustment.ceres.loss_function_scale": 1.0,
        "mapper.retriangulation.min_angle": 1.0,
        "mapper.ba_num_iterations": 3,
        "pipeline.min_num_matches": 15,
    }

    counted = positioning_options(options)

    assert set(counted) == {
        "mapper.rotation_averaging.max_rotation_error_deg",
        "mapper.max_angular_reproj_error_deg",
        "pipeline.min_num_matches",
    }
