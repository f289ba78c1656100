"""Times of listed images: their unit, what separates columns, and headers of each kind."""

from collections.abc import Callable, Sequence
from pathlib import Path

import pytest

from gtf_tune.errors import SequenceError
from gtf_tune.sequence import load_sequence

WriteImages = Callable[[Path, Sequence[str]], None]

# 50 ms apart; as floats, nanoseconds since 1970 would be rounded to multiples of 256.
NANOSECONDS = [1403636579763555584 + n * 50_000_000 for n in range(3)]
SECONDS = [stamp * 1e-9 for stamp in NANOSECONDS]
IN_UNITS = {
    "s": [f"{stamp // 10**9}.{stamp % 10**9:09d}" for stamp in NANOSECONDS],
    "ms": [f"{stamp // 10**6}.{stamp % 10**6:06d}" for stamp in NANOSECONDS],
    "us": [f"{stamp // 10**3}.{stamp % 10**3:03d}" for stamp in NANOSECONDS],
    "ns": [str(stamp) for stamp in NANOSECONDS],
}


@pytest.fixture(params=["rgb.txt", "cam0/data.csv"])
def listing(request: pytest.FixtureRequest, tmp_path: Path, write_images: WriteImages) -> Path:
    """Return the path of a list that a test writes, with the images a.png, b.png and c.png where it looks for them."""
    path = tmp_path / request.param
    write_images(path.parent / ("data" if path.suffix == ".csv" else ""), ["a.png", "b.png", "c.png"])
    return path


def _read(listing: Path, stamps: Sequence[str], separator: str = ",", header: str = "") -> list[float]:
    lines = [f"{stamp}{separator}{name}.png" for stamp, name in zip(stamps, "abc", strict=True)]
    listing.write_text("\n".join([*([header] if header else []), *lines]) + "\n")
    sequence = load_sequence(listing.parent if listing.name == "rgb.txt" else listing.parent.parent)
    assert [frame.path.name for frame in sequence.frames] == ["a.png", "b.png", "c.png"]
    return [float(frame.timestamp) for frame in sequence.frames]


@pytest.mark.parametrize("unit", IN_UNITS)
@pytest.mark.parametrize("header", ["", "# timestamp filename"])
def test_times_since_1970_show_their_unit_by_their_size(listing: Path, unit: str, header: str) -> None:
    assert _read(listing, IN_UNITS[unit], header=header) == pytest.approx(SECONDS, rel=0, abs=5e-7)


@pytest.mark.parametrize(
    ("header", "per_second"),
    [
        ("#timestamp [ns],filename", 1e9),
        ("timestamp_us image", 1e6),
        ("# time(ms); path", 1e3),
        ("Timestamp [s], Filename", 1),
    ],
)
def test_a_header_names_the_unit_with_and_without_a_comment_sign(listing: Path, header: str, per_second: float) -> None:
    assert _read(listing, ["0", "50", "100"], header=header) == pytest.approx([n / per_second for n in (0, 50, 100)])


@pytest.mark.parametrize("separator", [",", ";", " ", ", ", " ; ", "\t"])
def test_columns_are_separated_by_blanks_commas_or_semicolons(listing: Path, separator: str) -> None:
    assert _read(listing, IN_UNITS["ns"], separator, "timestamp filename") == pytest.approx(SECONDS, rel=0, abs=5e-7)


def test_stamps_of_19_digits_that_a_float_would_confuse_are_told_apart(listing: Path) -> None:
    stamps = [1403636579763555584 + n * 300 for n in range(3)]

    assert len({*_read(listing, [str(stamp) for stamp in stamps])}) == 3


def test_columns_may_be_the_other_way_round(listing: Path) -> None:
    lines = [f"{name}.png,{stamp}" for name, stamp in zip("abc", IN_UNITS["ns"], strict=True)]
    listing.write_text("\n".join(["filename,timestamp [ns]", *lines]))
    sequence = load_sequence(listing.parent if listing.name == "rgb.txt" else listing.parent.parent)

    assert [frame.timestamp for frame in sequence.frames] == pytest.approx(SECONDS, rel=0, abs=5e-7)


def test_a_comment_of_two_words_is_no_header_where_the_columns_say_otherwise(listing: Path) -> None:
    assert _read(listing, IN_UNITS["ns"], header="# recorded time") == pytest.approx(SECONDS, rel=0, abs=5e-7)


def test_a_line_of_words_that_names_no_time_is_no_header(listing: Path) -> None:
    with pytest.raises(SequenceError, match=r":1: expected numbers, found 'noon'"):
        _read(listing, ["1", "2", "3"], header="noon a.png")


def test_seconds_under_a_header_of_nanoseconds_are_refused(listing: Path) -> None:
    with pytest.raises(SequenceError, match=r":2: expected a time in whole nanoseconds, found '1403636579\.763555584'"):
        _read(listing, IN_UNITS["s"], header="#timestamp [ns],filename")
