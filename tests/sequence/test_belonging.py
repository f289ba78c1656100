"""Images and poses that do not obviously belong together are matched by what says so, or not at all."""

import re

import pytest

from gtf_tune.errors import SequenceError
from gtf_tune.sequence import load_sequence
from tests.sequence import miniatures


def test_kitti_images_that_were_renumbered_after_a_cut_get_no_poses(tmp_path):
    miniatures.kitti(tmp_path)
    (tmp_path / "image_0" / "000000.png").unlink()
    for number in range(1, miniatures.COUNT):
        image = tmp_path / "image_0" / f"{number:06d}.png"
        image.rename(image.with_stem(f"{number - 1:06d}"))
    miniatures.text(tmp_path / "times.txt", [f"{number * miniatures.PERIOD_S:e}" for number in range(1, 5)])

    sequence = load_sequence(tmp_path)

    assert sequence.ground_truth is None
    assert "the numbers of the images contradict their times" in sequence.notes[0]


@pytest.mark.parametrize("start", [0.0, 1403636579.0])
def test_kitti_images_that_keep_their_numbers_have_the_poses_of_these(tmp_path, start):
    miniatures.kitti(tmp_path)
    (tmp_path / "image_0" / "000000.png").unlink()
    miniatures.text(tmp_path / "times.txt", [f"{start + number * miniatures.PERIOD_S:.3f}" for number in range(1, 5)])

    assert load_sequence(tmp_path).ground_truth.positions[:, 0].tolist() == [1, 2, 3, 4]


def test_scannet_poses_belong_to_images_of_their_number(tmp_path):
    miniatures.scannet(tmp_path)
    for number in range(miniatures.COUNT):
        (tmp_path / "color" / f"{number}.jpg").rename(tmp_path / "color" / f"{number:06d}.jpg")
    (tmp_path / "pose" / "2.txt").unlink()

    truth = load_sequence(tmp_path).ground_truth

    assert (truth.frame_ids.tolist(), truth.positions[:, 0].tolist()) == ([0, 1, 3, 4], [0, 1, 3, 4])


def test_scannet_poses_of_no_image_are_noted(tmp_path):
    miniatures.scannet(tmp_path)
    for number in range(miniatures.COUNT):
        (tmp_path / "pose" / f"{number}.txt").rename(tmp_path / "pose" / f"pose-{number}.txt")

    sequence = load_sequence(tmp_path)

    assert sequence.ground_truth is None
    assert any(note.startswith("pose/ has poses, but none") for note in sequence.notes)


def test_a_list_of_associated_colour_and_depth_images_is_that_of_the_colour_images(tmp_path):
    miniatures.tum(tmp_path)
    rows = [f"{n * 0.2} rgb/{n}.png {n * 0.2 + 0.01} depth/{n}.png" for n in range(miniatures.COUNT)]
    miniatures.text(tmp_path / "rgb.txt", rows)

    sequence = load_sequence(tmp_path)

    assert [frame.path.name for frame in sequence.frames] == [f"{n}.png" for n in range(miniatures.COUNT)]
    assert len(sequence.ground_truth) == miniatures.COUNT


@pytest.mark.parametrize("layout", ["eth3d-slam", "kitti", "scannet"])
def test_a_damaged_image_is_not_a_fault_of_the_calibration(tmp_path, layout):
    miniatures.LAYOUTS[layout](tmp_path)
    image = load_sequence(tmp_path).frames[0].path
    image.write_bytes(b"")

    with pytest.raises(SequenceError, match=f"^{re.escape(str(image))}: "):
        load_sequence(tmp_path)


def test_a_listed_image_elsewhere_names_the_data_set(tmp_path):
    miniatures.tum(tmp_path)
    (tmp_path / "calibration.txt").unlink()
    miniatures.text(tmp_path / "rgb.txt", [f"{n * 0.2} /nowhere/{n}a.png" for n in range(miniatures.COUNT)])

    with pytest.raises(SequenceError, match=f"^{re.escape(str(tmp_path))}: /nowhere/0a.png: cannot read the image"):
        load_sequence(tmp_path)


@pytest.mark.parametrize(
    ("layout", "images"),
    [
        ("eth3d-slam", "rgb"),
        ("kitti", "image_0"),
        ("euroc", "mav0/cam0/data"),
        ("colmap", "images"),
        ("nerf", "images"),
        ("replica", "results"),
        ("scannet", "color"),
        ("tartanair", "image_left"),
        ("vslam-lab", "rgb_0"),
    ],
)
def test_images_out_of_a_data_set_say_so(tmp_path, layout, images):
    miniatures.LAYOUTS[layout](tmp_path)

    sequence = load_sequence(tmp_path / images)

    assert sequence.layout == "folder"
    assert f"{tmp_path} looks like layout '{layout}': give that folder to use its camera and poses" in sequence.notes


def test_kitti_times_in_nanoseconds_become_seconds(tmp_path):
    miniatures.kitti(tmp_path)
    miniatures.text(tmp_path / "times.txt", [f"{miniatures.stamp(number)}" for number in range(miniatures.COUNT)])

    times = [frame.timestamp for frame in load_sequence(tmp_path).frames]

    assert times[0] == pytest.approx(miniatures.START_NS / 1e9)
    assert times[-1] - times[0] == pytest.approx(4 * miniatures.PERIOD_S, abs=1e-5)


@pytest.mark.parametrize("path", ["rgb.txt", "rgb/0.png", "groundtruth.txt"])
def test_a_file_of_a_data_set_says_which_folder_to_give(tmp_path, path):
    miniatures.tum(tmp_path)

    with pytest.raises(SequenceError, match=r"expected a folder of images, found a file|give that folder"):
        load_sequence(tmp_path / path)


def test_a_folder_beside_the_images_says_which_folder_to_give(tmp_path):
    miniatures.colmap(tmp_path)

    with pytest.raises(SequenceError, match=r" looks like layout 'colmap': give that folder"):
        load_sequence(tmp_path / "sparse")
    with pytest.raises(SequenceError, match="or give the folder that holds both"):
        load_sequence(tmp_path / "sparse" / "0")


@pytest.mark.parametrize(
    ("layout", "file", "old", "new"),
    [
        ("eth3d-slam", "calibration.txt", "50 51 31.5 23.5", "1170 1170 647 483"),
        ("kitti", "calib.txt", "P0: 50 0 31.5 0 0 51 23.5", "P0: 700 0 601 0 0 700 183"),
        ("scannet", "intrinsic/intrinsic_color.txt", "50 0 31.5 0", "1170 0 647 0"),
    ],
)
def test_intrinsics_of_larger_images_are_refused_unless_the_camera_is_given(tmp_path, layout, file, old, new):
    miniatures.LAYOUTS[layout](tmp_path)
    path = tmp_path / file
    assert old in path.read_text()
    path.write_text(path.read_text().replace(old, new))

    with pytest.raises(SequenceError, match=r"principal point \d+, \d+ lies outside of the images.*give the camera"):
        load_sequence(tmp_path)
    assert load_sequence(tmp_path, camera="unknown").camera is None
