from pathlib import Path

import cv2
import numpy as np
import pytest

from gtf_tune.errors import SequenceError
from gtf_tune.sequence import Extraction, extract_video, load_sequence


def _write_video(path, pictures, rate_hz=30):
    height, width = pictures[0].shape[:2]
    writer = cv2.VideoWriter(str(path), cv2.VideoWriter_fourcc(*"MJPG"), rate_hz, (width, height))
    for picture in pictures:
        writer.write(picture)
    writer.release()
    return path


def _checker(offset):
    pattern = ((np.indices((48, 64)).sum(axis=0) + offset) // 4 % 2 * 255).astype(np.uint8)
    return cv2.merge([pattern] * 3)


@pytest.fixture
def video(tmp_path):
    """One second at 30 Hz, of which only the frames 4, 14 and 24 are sharp."""
    pictures = [cv2.GaussianBlur(_checker(n), (0, 0), 3) for n in range(30)]
    for n in (4, 14, 24):
        pictures[n] = _checker(n)
    return _write_video(tmp_path / "video.avi", pictures)


def test_regular_frames_keep_the_asked_rate_and_the_times_of_the_video(video, tmp_path):
    folder = extract_video(video, tmp_path / "out", Extraction(rate_hz=10, choice="regular"))

    sequence = load_sequence(folder)
    assert sequence.layout == "tum-rgbd"
    assert [frame.timestamp for frame in sequence.frames] == pytest.approx(np.arange(10) / 10, abs=1e-3)
    assert (sequence.width, sequence.height) == (64, 48)


def test_the_sharpest_frame_of_each_period_is_found(video, tmp_path):
    folder = extract_video(video, tmp_path / "out", Extraction(rate_hz=3))

    stamps = [frame.timestamp for frame in load_sequence(folder).frames]
    assert stamps == pytest.approx([4 / 30, 14 / 30, 24 / 30], abs=1e-3)


def test_start_stop_and_max_frames_limit_the_frames(video, tmp_path):
    limits = Extraction(rate_hz=10, choice="regular", start_s=0.2, stop_s=0.75, max_frames=4)

    stamps = [frame.timestamp for frame in load_sequence(extract_video(video, tmp_path / "out", limits)).frames]

    assert stamps == pytest.approx([0.2, 0.3, 0.4, 0.5], abs=1e-3)


def test_a_rate_above_that_of_the_video_takes_every_frame(video, tmp_path):
    folder = extract_video(video, tmp_path / "out", Extraction(rate_hz=1000))

    assert len(load_sequence(folder)) == 30


def test_a_video_given_as_a_sequence_says_how_to_extract_it(video):
    with pytest.raises(SequenceError, match="this is a video; take its frames out first, and give their folder"):
        load_sequence(video)


def test_a_missing_video_is_named(tmp_path):
    with pytest.raises(SequenceError, match=r"gone\.mp4: there is no such video"):
        extract_video(tmp_path / "gone.mp4", tmp_path / "out")


def test_a_file_that_is_no_video_is_named(tmp_path):
    (tmp_path / "text.mp4").write_text("not a video")

    with pytest.raises(SequenceError, match=r"text\.mp4: cannot be opened as a video"):
        extract_video(tmp_path / "text.mp4", tmp_path / "out")


def test_a_time_without_frames_is_refused(video, tmp_path):
    with pytest.raises(SequenceError, match="found no frames in the chosen time"):
        extract_video(video, tmp_path / "out", Extraction(start_s=60))


def test_a_folder_that_holds_a_sequence_is_left_alone(video, tmp_path):
    folder = extract_video(video, tmp_path / "out")

    with pytest.raises(SequenceError, match="there already is a sequence"):
        extract_video(video, folder)


@pytest.mark.parametrize(
    ("field", "value"),
    [("rate_hz", 0), ("rate_hz", float("nan")), ("choice", "best"), ("start_s", -1), ("max_frames", -1)],
)
def test_impossible_numbers_are_refused_by_name(field, value):
    with pytest.raises(SequenceError, match=field):
        Extraction(**{field: value})


def test_stop_before_start_is_refused():
    with pytest.raises(SequenceError, match="stop_s must be larger"):
        Extraction(start_s=5, stop_s=4)


def test_a_video_in_the_place_of_a_sequence_is_told_how_to_become_one(tmp_path: Path) -> None:
    video = tmp_path / "walk.MP4"
    video.write_bytes(b"any")

    with pytest.raises(SequenceError, match="this is a video; take its frames out first") as caught:
        load_sequence(video)
    assert caught.value.remedy == ("extract", "walk.MP4", "walk/")
