"""COLMAP projects with several models, unused cameras, or images elsewhere."""

import numpy as np
import pytest

from gtf_tune.errors import SequenceError
from gtf_tune.sequence import Camera, Selection, load_sequence
from tests.sequence import miniatures
from tests.sequence.miniatures import COUNT, model_text

NAMES = [f"{n}.png" for n in range(COUNT)]


@pytest.fixture
def project(tmp_path):
    miniatures.images(tmp_path, [f"images/{name}" for name in NAMES])
    return tmp_path


def test_the_largest_model_is_ground_truth_and_the_others_are_noted(project):
    model_text(project / "sparse" / "0", NAMES[:1])
    model_text(project / "sparse" / "1", NAMES[1:])

    sequence = load_sequence(project)

    assert sequence.ground_truth.frame_ids.tolist() == [1, 2, 3, 4]
    assert sequence.notes == ("sparse/1 has the most images of 2 models (4); the others are not used: sparse/0 (1)",)


@pytest.mark.parametrize("folder", ["sparse/1", "sparse/2", "sparse", "colmap/sparse/0", "."])
def test_a_model_may_be_the_only_one_under_any_number(project, folder):
    model_text(project / folder, NAMES)

    sequence = load_sequence(project)

    assert (sequence.layout, len(sequence.ground_truth), sequence.notes) == ("colmap", COUNT, ())


def test_of_equal_models_the_first_is_taken(project):
    model_text(project / "sparse" / "0", NAMES[:3])
    model_text(project / "sparse" / "10", NAMES[1:4])
    model_text(project / "sparse" / "2", NAMES[2:])

    assert load_sequence(project).ground_truth.frame_ids.tolist() == [0, 1, 2]


def test_a_damaged_model_does_not_hide_a_whole_one(project):
    model_text(project / "sparse" / "0", NAMES)
    (project / "sparse" / "0" / "images.txt").write_text("1 2 3\n")
    model_text(project / "sparse" / "1", NAMES[:2])

    sequence = load_sequence(project)

    assert len(sequence.ground_truth) == 2
    assert sequence.notes[0].startswith("sparse/0 is left out: ")
    (project / "sparse" / "1" / "images.txt").write_text("1 2 3\n")
    with pytest.raises(SequenceError, match=r"sparse/0 is left out: .*images\.txt, line 1"):
        load_sequence(project)


def test_cameras_that_no_image_uses_do_not_matter(project):
    model_text(project / "sparse" / "0", NAMES)
    with (project / "sparse" / "0" / "cameras.txt").open("a") as file:
        file.write("7 SIMPLE_RADIAL 4000 3000 3000 2000 1500 0\n8 MAGIC 64 48 1\n")

    assert load_sequence(project).camera == Camera("PINHOLE", 64, 48, (50, 51, 32, 24))


def test_each_image_has_its_camera_of_a_model_with_three(tmp_path):
    names = [f"{n}.png" for n in range(9)]
    miniatures.images(tmp_path, [f"images/{name}" for name in names])
    model_text(tmp_path / "sparse" / "0", names, {name: 2 + (name > "2.png") for name in names[:5]})
    with (tmp_path / "sparse" / "0" / "cameras.txt").open("a") as file:
        file.write("2 PINHOLE 64 48 60 60 32 24\n3 SIMPLE_RADIAL 64 48 55 32 24 0.1\n")

    sequence = load_sequence(tmp_path, selection=Selection(max_image_size=32))

    assert sequence.taken_by == (0, 0, 0, 1, 1, 2, 2, 2, 2)
    assert [camera.intrinsics.model for camera in sequence.cameras] == ["PINHOLE", "SIMPLE_RADIAL", "PINHOLE"]
    assert [camera.intrinsics.params[0] for camera in sequence.cameras] == [30, 27.5, 25]
    assert sequence.notes == ()


def test_two_ids_of_equal_intrinsics_are_one_camera(project):
    model_text(project / "sparse" / "0", NAMES, {NAMES[0]: 2})
    with (project / "sparse" / "0" / "cameras.txt").open("a") as file:
        file.write("2 PINHOLE 64 48 50 51 32 24\n")

    assert len(load_sequence(project)) == COUNT


@pytest.mark.parametrize("folder", ["input", "rgb", "."])
def test_images_may_lie_in_another_folder(project, folder):
    model_text(project / "sparse" / "0", NAMES)
    for path in (project / "images").iterdir():
        target = project / folder / path.name
        target.parent.mkdir(exist_ok=True)
        path.rename(target)

    assert len(load_sequence(project, layout="colmap")) == COUNT


def test_images_without_a_pose_are_frames_too(project):
    model_text(project / "sparse" / "0", NAMES[1:3])

    sequence = load_sequence(project)

    assert len(sequence) == COUNT
    np.testing.assert_array_equal(sequence.ground_truth.frame_ids, [1, 2])


def test_names_may_have_backslashes(project):
    (project / "images" / "left").mkdir()
    for name in NAMES:
        (project / "images" / name).rename(project / "images" / "left" / name)
    model_text(project / "sparse" / "0", [f"left\\{name}" for name in NAMES])

    sequence = load_sequence(project)

    assert [frame.path.name for frame in sequence.frames] == NAMES
    assert len(sequence.ground_truth) == COUNT
