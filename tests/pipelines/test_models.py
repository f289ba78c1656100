"""Models that COLMAP wrote are read as trajectories, and written as nerfstudio reads them."""

import json
from pathlib import Path

import numpy as np
import pycolmap
import pytest

from gtf_tune.errors import RunError
from gtf_tune.pipelines.colmap.clouds import read_cloud
from gtf_tune.pipelines.colmap.models import read_model, transforms_json

FRAMES = {f"{index:02d}.png": (3 * index, index / 10) for index in range(6)}


@pytest.fixture
def model(tmp_path: Path) -> Path:
    """Write a synthetic model of six images with one camera."""
    options = pycolmap.SyntheticDatasetOptions()
    options.num_rigs, options.num_cameras_per_rig, options.num_frames_per_rig, options.num_points3D = 1, 1, 6, 40
    options.camera_model_id = pycolmap.CameraModelId.SIMPLE_RADIAL
    options.camera_params = [1280.0, 512.0, 384.0, 0.05]
    made = pycolmap.synthesize_dataset(options)
    for image, name in zip(sorted(made.images), sorted(FRAMES), strict=True):
        made.images[image].name = name
    made.write_binary(tmp_path)
    return tmp_path


def test_the_trajectory_has_frame_ids_times_and_centres(model: Path) -> None:
    found = read_model(model, FRAMES)

    images = pycolmap.Reconstruction(model).images
    centres = {image.name: image.projection_center() for image in images.values()}
    assert found.trajectory.frame_ids.tolist() == [3 * index for index in range(6)]
    assert found.trajectory.timestamps.tolist() == [index / 10 for index in range(6)]
    assert np.allclose(found.trajectory.positions, [centres[name] for name in sorted(FRAMES)])
    assert found.num_points == 40


def test_images_that_nobody_asked_for_are_an_error(model: Path) -> None:
    with pytest.raises(RunError, match=r"holds image '05\.png', which is not among those reconstructed"):
        read_model(model, {name: frame for name, frame in FRAMES.items() if name != "05.png"})


def test_nerfstudio_gets_the_intrinsics_under_its_names(model: Path) -> None:
    found = json.loads(transforms_json(model, Path("/photos")))

    assert found["camera_model"] == "OPENCV"
    assert (found["fl_x"], found["fl_y"], found["cx"], found["cy"], found["k1"]) == (1280.0, 1280.0, 512.0, 384.0, 0.05)
    assert [frame["file_path"] for frame in found["frames"]] == [f"/photos/{name}" for name in sorted(FRAMES)]


def test_nerfstudio_gets_poses_that_look_along_minus_z(model: Path) -> None:
    frame = json.loads(transforms_json(model, Path("/photos")))["frames"][0]

    image = next(one for one in pycolmap.Reconstruction(model).images.values() if one.name == "00.png")
    pose = np.array(frame["transform_matrix"])
    assert np.allclose(pose[:3, 3], image.projection_center())
    assert np.allclose(-pose[:3, 2], image.viewing_direction())


def test_a_folder_without_a_model_is_one_sentence(tmp_path: Path) -> None:
    with pytest.raises(RunError, match="no COLMAP model can be read from"):
        read_model(tmp_path, FRAMES)


def test_a_picture_has_points_colours_and_cameras_that_see_the_points(model: Path) -> None:
    found = read_cloud(model)

    images = pycolmap.Reconstruction(model).images
    assert found.points.shape == found.colours.shape == (40, 3)
    assert found.num_points == 40
    assert found.names == tuple(sorted(FRAMES))
    for image in images.values():
        place = found.names.index(image.name)
        assert np.allclose(found.centres[place], image.projection_center())
        assert np.allclose(found.axes[place, 2], image.viewing_direction())
        assert np.allclose(found.corners[place].mean(axis=0), image.viewing_direction())
        assert np.linalg.norm(found.corners[place, 0] - found.corners[place, 1]) == pytest.approx(1024 / 1280)
