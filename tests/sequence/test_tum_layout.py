import os
from pathlib import Path

import numpy as np
import pytest

from gtf_tune.errors import SequenceError, TrajectoryError
from gtf_tune.sequence import Camera, Selection, load_sequence


@pytest.fixture
def recording(tmp_path, write_images):
    """A miniature of a TUM RGB-D sequence: five images at 30 Hz and poses at 100 Hz that begin 40 ms late."""
    stamps = [1305031102.175304 + n / 30 for n in range(5)]
    write_images(tmp_path, [f"rgb/{stamp:.6f}.png" for stamp in stamps])
    lines = [f"{stamp:.6f} rgb/{stamp:.6f}.png" for stamp in stamps]
    (tmp_path / "rgb.txt").write_text("# color images\n# timestamp filename\n" + "\n".join(lines) + "\n")
    poses = [f"{stamps[0] + 0.04 + n / 100:.4f} {n} 0 0 0 0 0 1" for n in range(20)]
    (tmp_path / "groundtruth.txt").write_text("# timestamp tx ty tz qx qy qz qw\n" + "\n".join(poses) + "\n")
    return tmp_path


def test_images_and_timestamps_come_from_the_list(recording):
    sequence = load_sequence(recording)

    assert (sequence.layout, len(sequence), sequence.camera) == ("tum-rgbd", 5, None)
    assert sequence.frames[1].timestamp == pytest.approx(1305031102.208637, abs=1e-6)
    assert sequence.has_timestamps


def test_the_mark_that_some_editors_put_before_a_text_is_skipped(recording):
    text = (recording / "rgb.txt").read_text()
    (recording / "rgb.txt").write_text(text, encoding="utf-8-sig")

    assert len(load_sequence(recording)) == 5


def test_poses_go_to_the_frames_within_20_milliseconds(recording):
    truth = load_sequence(recording).ground_truth

    # Frame 0 is 40 ms before the first pose; frame n is nearest to pose round(100 (n / 30 - 0.04)).
    assert truth.frame_ids.tolist() == [1, 2, 3, 4]
    assert truth.positions[:, 0].tolist() == [0, 3, 6, 9]
    assert truth.timestamps.tolist() == [frame.timestamp for frame in load_sequence(recording).frames[1:]]


def test_ground_truth_follows_the_selection(recording):
    truth = load_sequence(recording, selection=Selection(stride=2)).ground_truth

    assert truth.frame_ids.tolist() == [2, 4]


def test_calibration_makes_it_the_layout_of_eth3d_slam(recording):
    (recording / "calibration.txt").write_text("50.0 51.0 31.5 23.5\n")

    sequence = load_sequence(recording)

    assert sequence.layout == "eth3d-slam"
    assert sequence.camera == Camera("PINHOLE", 64, 48, (50, 51, 32, 24))


def test_ground_truth_is_optional(recording):
    (recording / "groundtruth.txt").unlink()

    assert load_sequence(recording).ground_truth is None


def test_poses_of_another_time_are_noted(recording):
    (recording / "groundtruth.txt").write_text("5.0 0 0 0 0 0 0 1\n6.0 0 0 0 0 0 0 1\n")

    sequence = load_sequence(recording)

    assert sequence.ground_truth is None
    assert sequence.notes == ("groundtruth.txt has 2 poses, but none within 0.02 s of an image",)


def test_a_single_pose_is_enough_for_its_frame(recording):
    stamp = load_sequence(recording).frames[2].timestamp
    (recording / "groundtruth.txt").write_text(f"{stamp} 7 0 0 0 0 0 1\n")

    assert load_sequence(recording).ground_truth.frame_ids.tolist() == [2]


@pytest.mark.parametrize(
    ("line", "message"),
    [
        ("1305031109.0 rgb/1305031102.175304.png", r"lists the image 1305031102\.175304\.png twice"),
        ("1305031102.308637 rgb/new.png", r"new\.png repeats the timestamp 1305031102\.308637"),
        ("1305031101.0 rgb/new.png", r"new\.png goes back to the timestamp"),
        ("1305031109.0", r"rgb\.txt:8: expected 'timestamp image'"),
        ("noon rgb/new.png", r"rgb\.txt:8: expected numbers, found 'noon'"),
        ("nan rgb/new.png", r"rgb\.txt:8: expected finite numbers"),
        ("1305031109.0 rgb/new.png", r"new\.png: cannot read the image"),
    ],
)
def test_faulty_lines_are_named(recording, line, message):
    with (recording / "rgb.txt").open("a") as file:
        file.write(line + "\n")

    with pytest.raises(SequenceError, match=message):
        load_sequence(recording)


def test_a_list_without_images_is_refused(recording):
    (recording / "rgb.txt").write_text("# nothing\n")

    with pytest.raises(SequenceError, match=r"rgb\.txt: lists no images"):
        load_sequence(recording)


@pytest.mark.parametrize("text", ["50 50 31\n", "50 50 31 23 0\n", ""])
def test_calibration_with_another_count_of_numbers_is_refused(recording, text):
    (recording / "calibration.txt").write_text(text)

    with pytest.raises(SequenceError, match=r"calibration\.txt: expected 'fx fy cx cy'"):
        load_sequence(recording)


def test_faulty_poses_are_named(recording):
    (recording / "groundtruth.txt").write_text("1.0 0 0 0\n")

    with pytest.raises(TrajectoryError, match=r"groundtruth\.txt"):
        load_sequence(recording)


@pytest.mark.skipif("GTF_TUNE_DATA" not in os.environ, reason="GTF_TUNE_DATA does not name the folder of real data")
@pytest.mark.parametrize(("name", "frames"), [("fountain-P11", 11), ("hut", 25), ("dtu-scan24", 49), ("kitti07", 40)])
def test_real_data_load_with_ground_truth_and_intrinsics(name, frames):
    sequence = load_sequence(Path(os.environ["GTF_TUNE_DATA"]) / name)

    assert (len(sequence), len(sequence.ground_truth)) == (frames, frames)
    assert sequence.camera.params[2:] == pytest.approx((sequence.width / 2, sequence.height / 2), rel=0.05)
    assert np.ptp(sequence.ground_truth.positions) > 1
