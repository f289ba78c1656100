import struct

import cv2
import numpy as np
import pytest

from gtf_tune.errors import SequenceError
from gtf_tune.sequence.images import image_size, read_grey

FORMATS = ["png", "jpg", "jpeg", "bmp", "tif", "tiff", "pgm", "ppm", "PNG"]
RAMP = np.tile(np.arange(64, dtype=np.uint8) * 4, (48, 1))


@pytest.mark.parametrize("suffix", FORMATS)
def test_every_format_gives_its_size_and_pixels(tmp_path, suffix):
    path = tmp_path / f"ä image.{suffix}"
    cv2.imwrite(str(path), RAMP if suffix == "pgm" else cv2.merge([RAMP] * 3))

    assert image_size(path) == (64, 48)
    np.testing.assert_allclose(read_grey(path), RAMP, atol=4)


def test_colour_becomes_grey_by_the_weights_of_opencv(tmp_path):
    cv2.imwrite(str(tmp_path / "a.png"), np.full((2, 2, 3), (10, 100, 200), np.uint8))

    assert read_grey(tmp_path / "a.png")[0, 0] == round(0.114 * 10 + 0.587 * 100 + 0.299 * 200)


def test_alpha_is_ignored(tmp_path):
    cv2.imwrite(str(tmp_path / "a.png"), np.full((2, 2, 4), (50, 50, 50, 0), np.uint8))

    assert read_grey(tmp_path / "a.png")[0, 0] == 50


def test_sixteen_bits_cover_the_whole_range_of_eight(tmp_path):
    values = np.array([[0, 128, 129, 257, 32768, 65535]], np.uint16)
    cv2.imwrite(str(tmp_path / "a.png"), values)

    np.testing.assert_array_equal(read_grey(tmp_path / "a.png"), [[0, 0, 1, 1, 128, 255]])


def test_sixteen_bit_colour_is_read(tmp_path):
    cv2.imwrite(str(tmp_path / "a.tif"), np.full((4, 4, 3), 257 * 99, np.uint16))

    assert read_grey(tmp_path / "a.tif")[0, 0] == 99


def test_exif_orientation_is_ignored(tmp_path):
    path = tmp_path / "a.jpg"
    cv2.imwrite(str(path), RAMP)
    # A TIFF header with the single entry Orientation (0x0112) = 6, "rotate by 90 degrees".
    entry = b"\x00\x01" + b"\x01\x12\x00\x03\x00\x00\x00\x01\x00\x06\x00\x00" + b"\x00\x00\x00\x00"
    exif = b"Exif\x00\x00" + b"MM\x00\x2a\x00\x00\x00\x08" + entry
    data = path.read_bytes()
    path.write_bytes(data[:2] + b"\xff\xe1" + (len(exif) + 2).to_bytes(2, "big") + exif + data[2:])

    assert cv2.imread(str(path)).shape[:2] == (64, 48)
    assert image_size(path) == (64, 48)
    assert read_grey(path).shape == (48, 64)


@pytest.mark.parametrize("order", ["<", ">"])
@pytest.mark.parametrize("orientation", [3, 6])
def test_the_orientation_of_a_tiff_is_ignored(tmp_path, order, orientation):
    path = tmp_path / "a.tif"
    write_tiff(path, RAMP[..., None], order, {274: orientation})

    assert image_size(path) == (64, 48)
    np.testing.assert_array_equal(read_grey(path), RAMP)


def test_the_alpha_of_a_tiff_is_ignored(tmp_path):
    path = tmp_path / "a.tif"
    write_tiff(path, np.dstack([RAMP, RAMP, RAMP, np.full_like(RAMP, 100)]), "<", {338: 2})

    np.testing.assert_array_equal(read_grey(path), RAMP)


def write_tiff(path, pixels, order, more):
    """Write an uncompressed TIFF of 8 bits in one strip with tags of our own, which OpenCV's writer does not take."""
    height, width, channels = pixels.shape
    tags = {256: width, 257: height, 258: 8, 259: 1, 262: 2 if channels > 1 else 1, 273: 512, 277: channels}
    tags = dict(sorted((tags | {278: height, 279: pixels.size} | more).items()))
    head = (b"II" if order == "<" else b"MM") + struct.pack(f"{order}HI", 42, 8) + struct.pack(f"{order}H", len(tags))
    entries = b"".join(_entry(order, tag, value, channels) for tag, value in tags.items())
    path.write_bytes((head + entries).ljust(500, b"\0") + struct.pack(f"{order}4H", 8, 8, 8, 8).ljust(12, b"\0"))
    path.write_bytes(path.read_bytes() + pixels.tobytes())


def _entry(order, tag, value, channels):
    if tag == 258 and channels > 2:
        return struct.pack(f"{order}HHII", tag, 3, channels, 500)
    kind, text = (3, "HHIHH") if tag not in (273, 279) else (4, "HHII")
    return struct.pack(f"{order}{text}", tag, kind, 1, value, *([0] if kind == 3 else []))


def test_a_film_behind_a_photograph_is_skipped(tmp_path):
    path = tmp_path / "motion.jpg"
    cv2.imwrite(str(path), RAMP)
    path.write_bytes(path.read_bytes() + bytes(1 << 17))

    assert image_size(path) == (64, 48)
    np.testing.assert_allclose(read_grey(path), RAMP, atol=4)


def test_the_end_of_a_thumbnail_is_not_taken_for_that_of_its_image(tmp_path):
    path = tmp_path / "cut.jpg"
    cv2.imwrite(str(path), np.random.default_rng(0).integers(0, 255, (512, 512), np.uint8))
    thumbnail = b"\xff\xe1\x00\x06ab\xff\xd9"
    path.write_bytes(b"\xff\xd8" + thumbnail + path.read_bytes()[2 : 1 << 17])

    with pytest.raises(SequenceError, match="cut off"):
        image_size(path)


@pytest.mark.parametrize("suffix", ["png", "jpg", "bmp", "tif", "pgm"])
def test_cut_off_files_are_named(tmp_path, suffix):
    path = tmp_path / f"cut.{suffix}"
    cv2.imwrite(str(path), np.random.default_rng(0).integers(0, 255, (48, 64), dtype=np.uint8))
    path.write_bytes(path.read_bytes()[:-500])

    with pytest.raises(SequenceError, match=rf"cut\.{suffix}: "):
        read_grey(path)
    with pytest.raises(SequenceError, match=rf"cut\.{suffix}: "):
        image_size(path)


@pytest.mark.parametrize("content", [b"", b"no image at all", b"\x89PNG\r\n\x1a\nIEND", b"\xff\xd8\xff\xd9"])
def test_files_without_an_image_are_named(tmp_path, content):
    path = tmp_path / "bad.png"
    path.write_bytes(content)

    with pytest.raises(SequenceError, match=r"bad\.png: "):
        read_grey(path)
    with pytest.raises(SequenceError, match=r"bad\.png: "):
        image_size(path)


def test_missing_files_are_named(tmp_path):
    with pytest.raises(SequenceError, match=r"gone\.png: cannot read the image \(No such file"):
        read_grey(tmp_path / "gone.png")
    with pytest.raises(SequenceError, match=r"gone\.png: cannot read the image \(No such file"):
        image_size(tmp_path / "gone.png")


def test_floating_point_images_are_refused(tmp_path):
    cv2.imwrite(str(tmp_path / "float.tif"), np.zeros((4, 4), np.float32))

    with pytest.raises(SequenceError, match="8 or 16 bits per channel, not float32"):
        read_grey(tmp_path / "float.tif")
