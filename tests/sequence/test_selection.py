import pytest
from hypothesis import given
from hypothesis import strategies as st

from gtf_tune.errors import SequenceError
from gtf_tune.sequence import Selection

AT_30_HZ = [number / 30 for number in range(2000)]


def test_default_keeps_everything():
    assert Selection().positions(AT_30_HZ) == list(range(2000))
    assert Selection().image_size(1920, 1080) == (1920, 1080)


def test_start_stop_and_stride_act_like_a_slice():
    assert Selection(start=10, stop=20, stride=3).positions(AT_30_HZ) == [10, 13, 16, 19]


def test_the_selection_of_the_paper_is_50_frames_over_16_seconds():
    chosen = Selection(rate_hz=3.0, max_frames=50).positions(AT_30_HZ)

    assert chosen == list(range(0, 500, 10))
    assert round(len(chosen) / (AT_30_HZ[chosen[-1]] - AT_30_HZ[chosen[0]]), 2) == 3.06


def test_max_frames_keeps_the_first_ones():
    assert Selection(start=5, max_frames=2).positions(AT_30_HZ) == [5, 6]


@given(rate=st.floats(0.5, 29.0))
def test_thinning_keeps_the_mean_rate(rate):
    chosen = Selection(rate_hz=rate).positions(AT_30_HZ)

    duration = AT_30_HZ[chosen[-1]] - AT_30_HZ[chosen[0]]
    assert abs((len(chosen) - 1) - duration * rate) <= 1


def test_thinning_to_the_rate_of_the_recording_keeps_every_frame_despite_rounded_timestamps():
    rounded = [round(stamp, 6) for stamp in AT_30_HZ]

    assert len(Selection(rate_hz=30).positions(rounded)) == 2000


def test_thinning_takes_up_the_beat_after_a_gap():
    stamps = [0.0, 0.1, 0.2, 5.05, 5.1, 5.15, 5.2, 5.3]

    assert Selection(rate_hz=10).positions(stamps) == [0, 1, 2, 3, 4, 6, 7]


def test_images_shrink_to_the_longer_side_and_never_grow():
    assert Selection(max_image_size=512).image_size(1024, 683) == (512, 342)
    assert Selection(max_image_size=512).image_size(300, 400) == (300, 400)
    assert Selection(max_image_size=10).image_size(5, 10000) == (1, 10)


@pytest.mark.parametrize(
    ("field", "value"),
    [
        ("start", -1),
        ("stop", -5),
        ("stride", 0),
        ("stride", 1.5),
        ("rate_hz", -3.0),
        ("rate_hz", float("nan")),
        ("max_frames", -1),
        ("max_image_size", -2),
    ],
)
def test_impossible_numbers_are_refused_by_name(field, value):
    with pytest.raises(SequenceError, match=field):
        Selection(**{field: value})


def test_stop_before_start_is_refused():
    with pytest.raises(SequenceError, match=r"stop must be larger than start \(10\)"):
        Selection(start=10, stop=5)
