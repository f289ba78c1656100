"""Damaged images are refused by name; whatever stands around a whole one does not matter."""

import io
import struct
import zlib

import cv2
import numpy as np
import pytest
from PIL import Image

from gtf_tune.errors import SequenceError
from gtf_tune.sequence.images import image_size, read_grey

HEIGHT, WIDTH = 96, 128


def _pixels():
    rng = np.random.default_rng(0)
    return cv2.GaussianBlur(rng.integers(0, 255, (HEIGHT, WIDTH, 3), dtype=np.uint8), (0, 0), 1)


def _jpeg():
    return bytearray(cv2.imencode(".jpg", _pixels(), [cv2.IMWRITE_JPEG_QUALITY, 90])[1].tobytes())


def _scan(data):
    """Return where the compressed pixels of a JPEG begin."""
    return data.index(b"\xff\xda") + 14


def _saved(path, data):
    path.write_bytes(bytes(data))
    return path


@pytest.mark.parametrize("damage", ["zeros", "hole", "noise"])
def test_damaged_jpeg_pixels_are_refused(tmp_path, damage):
    data = _jpeg()
    middle = (_scan(data) + len(data)) // 2
    if damage == "zeros":
        data[middle : middle + 400] = bytes(400)
    elif damage == "hole":
        del data[middle : middle + 700]
    else:
        data[middle : middle + 400] = bytes(np.random.default_rng(1).integers(0, 255, 400, dtype=np.uint8))

    with pytest.raises(SequenceError, match=r"a\.jpg: the pixels are damaged \(Corrupt JPEG data.*; replace the file"):
        read_grey(_saved(tmp_path / "a.jpg", data))


@pytest.mark.parametrize("more", ["comment", "broken profile", "trailing film", "bytes before the end"])
def test_a_whole_jpeg_is_read_whatever_stands_around_its_pixels(tmp_path, more):
    data = _jpeg()
    expected = read_grey(_saved(tmp_path / "plain.jpg", data))
    if more == "comment":
        data[2:2] = b"\xff\xfe\x00\x06hell"
    elif more == "broken profile":
        data[2:2] = b"\xff\xe2\x00\x10ICC_PROFILE\x00\x07\x01"
    elif more == "trailing film":
        data += bytes(np.random.default_rng(2).integers(0, 255, 100_000, dtype=np.uint8))
    else:
        data[-2:-2] = b"\x00\x00\x00\x00"

    np.testing.assert_array_equal(read_grey(_saved(tmp_path / "a.jpg", data)), expected)


def test_progressive_and_grey_jpegs_are_read(tmp_path):
    for name, mode in (("progressive.jpg", "RGB"), ("grey.jpg", "L"), ("cmyk.jpg", "CMYK")):
        Image.fromarray(_pixels()).convert(mode).save(tmp_path / name, progressive=name == "progressive.jpg")

        assert read_grey(tmp_path / name).shape == (HEIGHT, WIDTH)


def _tiff(compression):
    file = io.BytesIO()
    Image.fromarray(_pixels()).save(file, "TIFF", compression=compression)
    return bytearray(file.getvalue())


@pytest.mark.parametrize("compression", ["tiff_lzw", "tiff_adobe_deflate"])
def test_damaged_tiff_pixels_are_refused(tmp_path, compression):
    data = _tiff(compression)
    data[len(data) // 2 : len(data) // 2 + 300] = bytes(np.random.default_rng(1).integers(0, 255, 300, dtype=np.uint8))

    with pytest.raises(SequenceError, match=r"a\.tif: "):
        read_grey(_saved(tmp_path / "a.tif", data))


@pytest.mark.parametrize("compression", ["raw", "tiff_lzw", "tiff_adobe_deflate", "packbits"])
def test_whole_tiffs_are_read(tmp_path, compression):
    expected = cv2.cvtColor(_pixels()[..., ::-1].copy(), cv2.COLOR_BGR2GRAY)

    np.testing.assert_array_equal(read_grey(_saved(tmp_path / "a.tif", _tiff(compression))), expected)


def test_sixteen_bit_tiffs_that_pillow_does_not_know_are_read(tmp_path):
    pixels = (_pixels().astype(np.uint16)) * 257
    cv2.imwrite(str(tmp_path / "a.tif"), pixels, [cv2.IMWRITE_TIFF_COMPRESSION, 5])

    assert read_grey(tmp_path / "a.tif").shape == (HEIGHT, WIDTH)


def _png():
    return cv2.imencode(".png", _pixels())[1].tobytes()


def test_a_whole_png_is_read_with_bytes_behind_its_end(tmp_path):
    path = _saved(tmp_path / "a.png", _png() + bytes(200_000))

    np.testing.assert_array_equal(read_grey(path), cv2.cvtColor(_pixels(), cv2.COLOR_BGR2GRAY))
    assert image_size(path) == (WIDTH, HEIGHT)


def test_a_cut_png_is_refused_whatever_follows(tmp_path):
    path = _saved(tmp_path / "a.png", _png()[:-40] + bytes(200_000))

    for read in (read_grey, image_size):
        with pytest.raises(SequenceError, match=r"a\.png: the image file is cut off"):
            read(path)


def _png_header(width, height):
    data = struct.pack(">IIBBBBB", width, height, 8, 0, 0, 0, 0)
    chunk = b"IHDR" + data
    end = b"\x00\x00\x00\x00IEND\xaeB`\x82"
    return b"\x89PNG\r\n\x1a\n" + struct.pack(">I", 13) + chunk + struct.pack(">I", zlib.crc32(chunk)) + end


@pytest.mark.parametrize(("width", "height"), [(60_000, 60_000), (2**31 - 1, 2**31 - 1)])
def test_an_image_of_too_many_pixels_is_refused_before_it_is_decoded(tmp_path, width, height):
    path = _saved(tmp_path / "a.png", _png_header(width, height))

    with pytest.raises(SequenceError, match="expected at most 268 million pixels, found"):
        image_size(path)
    with pytest.raises(SequenceError, match=r"a\.png: "):
        read_grey(path)


@pytest.mark.parametrize("suffix", [".webp", ".avif", ".jp2"])
def test_newer_formats_are_read_and_cut_files_refused(tmp_path, suffix):
    data = cv2.imencode(suffix, _pixels())[1].tobytes()
    path = _saved(tmp_path / f"a{suffix}", data)

    assert read_grey(path).shape == (HEIGHT, WIDTH)
    assert image_size(path) == (WIDTH, HEIGHT)
    with pytest.raises(SequenceError, match=rf"b\{suffix}: "):
        read_grey(_saved(tmp_path / f"b{suffix}", data[: len(data) // 2]))


def test_heic_is_read_by_its_own_package(tmp_path):
    heif = pytest.importorskip("pillow_heif")
    heif.from_pillow(Image.fromarray(_pixels()[..., ::-1])).save(tmp_path / "a.heic", quality=100)

    grey = read_grey(tmp_path / "a.heic")

    assert image_size(tmp_path / "a.heic") == (WIDTH, HEIGHT)
    expected = cv2.cvtColor(_pixels(), cv2.COLOR_BGR2GRAY)
    assert np.abs(grey.astype(int) - expected).mean() < 3
    with pytest.raises(SequenceError, match=r"b\.heic: cannot be decoded"):
        read_grey(_saved(tmp_path / "b.heic", (tmp_path / "a.heic").read_bytes()[:200]))


def test_heic_without_its_package_says_what_to_install(tmp_path, monkeypatch):
    monkeypatch.setitem(__import__("sys").modules, "pillow_heif", None)

    with pytest.raises(SequenceError, match=r"HEIC needs the package pillow-heif; install it with: pip install"):
        read_grey(_saved(tmp_path / "a.heic", b"\0\0\0\x18ftypheic"))
