"""Read image files as 8-bit grey, and their sizes without decoding them."""

import struct
from collections.abc import Iterator
from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray

from gtf_tune.errors import SequenceError
from gtf_tune.sequence.image_noise import GreyImage

IMAGE_SUFFIXES = frozenset({".bmp", ".jpeg", ".jpg", ".pgm", ".png", ".ppm", ".tif", ".tiff"})
IMAGE_KINDS = ", ".join(sorted(suffix[1:] for suffix in IMAGE_SUFFIXES))
"""The formats that are read, for messages."""

_HEADER_BYTES = 1 << 16
_TAIL_BYTES = 1 << 16
_UINT8_STEP = 257
_JPEG_SCAN = 0xDA
_JPEG_END = b"\xff\xd9"

# TIFF tags by which OpenCV would change pixels, and values with which it does not: upright, and alpha multiplied in.
_TIFF_ORDERS = {b"II*\x00": "<", b"MM\x00*": ">"}
_TIFF_SHORT = 3
_TIFF_NEUTRAL = {0x0112: 1, 0x0152: 1}


def is_image(path: Path) -> bool:
    """Tell whether the name is that of an image; hidden files (as macOS leaves them) are not."""
    return path.suffix.lower() in IMAGE_SUFFIXES and not path.name.startswith(".")


def read_grey(path: Path) -> GreyImage:
    """Return an image file as 8-bit grey of shape (h, w).

    Colour becomes grey by OpenCV's weights (0.299 R + 0.587 G + 0.114 B); an alpha channel is ignored. 16-bit values
    are divided by 257 and rounded, so that 65535 becomes 255: images that use only the lower bits stay dark. The EXIF
    orientation is ignored, because intrinsics belong to the pixels as they are stored.

    Raises
    ------
    SequenceError
        The file is missing, empty, damaged, not an image, or neither 8 nor 16 bits deep.
    """
    data = _read_bytes(path)
    _check_complete(path, data[:4], data[-_TAIL_BYTES:])
    pixels = cv2.imdecode(np.frombuffer(_as_stored(data), dtype=np.uint8), cv2.IMREAD_UNCHANGED)
    if pixels is None:
        raise SequenceError(f"{path}: cannot be decoded as an image; replace the file or leave the frame out")
    return _to_grey(path, pixels)


def image_size(path: Path) -> tuple[int, int]:
    """Return (width, height) in pixels, from the header where the format has a simple one.

    Raises
    ------
    SequenceError
        The file is missing, empty, cut off or not an image.
    """
    try:
        with path.open("rb") as file:
            head = file.read(_HEADER_BYTES)
            file.seek(max(0, path.stat().st_size - _TAIL_BYTES))
            tail = file.read()
    except OSError as error:
        raise _unreadable(path, error) from error
    _check_not_empty(path, head)
    _check_complete(path, head[:4], tail)
    size = _size_from_header(head) or tuple(read_grey(path).shape[::-1])
    if min(size) < 1:
        raise SequenceError(f"{path}: the image has no pixels ({size[0]}x{size[1]}); leave the frame out")
    return size[0], size[1]


def sharpness(grey: GreyImage) -> float:
    """Return the variance of the Laplacian, which falls with blur; comparable between images of one scene only."""
    return float(cv2.Laplacian(grey, cv2.CV_32F).var())


def _read_bytes(path: Path) -> bytes:
    try:
        data = path.read_bytes()
    except OSError as error:
        raise _unreadable(path, error) from error
    _check_not_empty(path, data)
    return data


def _unreadable(path: Path, error: OSError) -> SequenceError:
    return SequenceError(f"{path}: cannot read the image ({error.strerror}); check the path and its permissions")


def _check_not_empty(path: Path, data: bytes) -> None:
    if not data:
        raise SequenceError(f"{path}: the image file is empty; replace the file or leave the frame out")


def _check_complete(path: Path, magic: bytes, tail: bytes) -> None:
    """Find cut-off files: libjpeg fills what is missing with grey and reports success."""
    is_jpeg = magic.startswith(b"\xff\xd8\xff")
    end = _JPEG_END if is_jpeg else b"IEND" if magic == b"\x89PNG" else b""
    if end not in tail and not (is_jpeg and _ends_before_more(_read_bytes(path))):
        raise SequenceError(f"{path}: the image file is cut off; replace the file or leave the frame out")


def _ends_before_more(data: bytes) -> bool:
    """Tell whether a JPEG image is whole and other data follow it, as phones append the film of a motion photo."""
    scan = next((at for marker, at in _jpeg_segments(data) if marker == _JPEG_SCAN), len(data))
    return _JPEG_END in data[scan:]


def _to_grey(path: Path, pixels: NDArray[np.generic]) -> GreyImage:
    if pixels.dtype not in (np.uint8, np.uint16):
        raise SequenceError(f"{path}: expected 8 or 16 bits per channel, not {pixels.dtype}; convert the image")
    if pixels.ndim == 3:
        codes = {1: None, 3: cv2.COLOR_BGR2GRAY, 4: cv2.COLOR_BGRA2GRAY}
        if pixels.shape[2] not in codes:
            raise SequenceError(f"{path}: expected 1, 3 or 4 channels, not {pixels.shape[2]}; convert the image")
        code = codes[pixels.shape[2]]
        pixels = pixels[..., 0] if code is None else cv2.cvtColor(pixels, code)
    if pixels.dtype == np.uint16:
        pixels = np.rint(pixels.astype(np.float32) / _UINT8_STEP).astype(np.uint8)
    return np.ascontiguousarray(pixels, dtype=np.uint8)


def _as_stored(data: bytes) -> bytes:
    """Return TIFF data without orientation and meaning of alpha, which OpenCV applies to this format alone."""
    order = _TIFF_ORDERS.get(data[:4])
    if order is None or len(data) < 8:
        return data
    (start,) = struct.unpack_from(f"{order}I", data, 4)
    count = struct.unpack_from(f"{order}H", data, start)[0] if start + 2 <= len(data) else 0
    changed = bytearray(data)
    for at in range(start + 2, min(start + 2 + 12 * count, len(data) - 11), 12):
        tag, kind, values = struct.unpack_from(f"{order}HHI", data, at)
        if tag in _TIFF_NEUTRAL and (kind, values) == (_TIFF_SHORT, 1):
            struct.pack_into(f"{order}H", changed, at + 8, _TIFF_NEUTRAL[tag])
    return bytes(changed)


def _size_from_header(head: bytes) -> tuple[int, int] | None:
    if head.startswith(b"\x89PNG") and len(head) >= 24:
        width, height = struct.unpack(">II", head[16:24])
        return width, height
    if head.startswith(b"\xff\xd8"):
        return _jpeg_size(head)
    return None


def _jpeg_size(head: bytes) -> tuple[int, int] | None:
    """Read the frame header (SOF0..SOF15 without DHT, JPG and DAC)."""
    for marker, at in _jpeg_segments(head):
        if 0xC0 <= marker <= 0xCF and marker not in (0xC4, 0xC8, 0xCC):
            height, width = struct.unpack(">HH", head[at + 5 : at + 9])
            return width, height
    return None


def _jpeg_segments(data: bytes) -> Iterator[tuple[int, int]]:
    """Yield the marker of each segment and where it begins, up to the first scan."""
    at, marker = 2, 0
    while at + 9 <= len(data) and data[at] == 0xFF and marker != _JPEG_SCAN:
        marker = data[at + 1]
        if marker != 0xFF:  # more of them may stand before a marker
            yield marker, at
        at += 1 if marker == 0xFF else 2 + int(struct.unpack(">H", data[at + 2 : at + 4])[0])
