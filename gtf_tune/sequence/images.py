"""Read image files as 8-bit grey or colour, and their sizes without decoding them."""

import io
import re
import struct
import warnings
import zlib
from collections.abc import Iterator
from pathlib import Path
from typing import BinaryIO

import cv2
import numpy as np
import simplejpeg
from numpy.typing import NDArray
from PIL import Image, UnidentifiedImageError

from gtf_tune.errors import SequenceError
from gtf_tune.sequence.image_formats import HEIF_SUFFIXES, LATER_SUFFIXES
from gtf_tune.sequence.image_noise import ColourImage, GreyImage

_HEADER_BYTES = 1 << 16
_UINT8_STEP = 257
_MOST_PIXELS = 1 << 28

# TIFF tags by which OpenCV would change pixels, and values with which it does not: upright, and alpha multiplied in.
_TIFF_ORDERS = {b"II*\x00": "<", b"MM\x00*": ">"}
_TIFF_SHORT = 3
_TIFF_NEUTRAL = {0x0112: 1, 0x0152: 1}

_LEAVE_OUT = "replace the file, or leave it out with exclude"


def read_grey(path: Path) -> GreyImage:
    """Return an image file as 8-bit grey of shape (h, w).

    Colour becomes grey by OpenCV's weights (0.299 R + 0.587 G + 0.114 B); an alpha channel is ignored. 16-bit values
    are divided by 257 and rounded, so that 65535 becomes 255: images that use only the lower bits stay dark. The EXIF
    orientation is ignored, because intrinsics belong to the pixels as they are stored; HEIC comes upright.

    Raises
    ------
    SequenceError
        The file is missing, empty, damaged, not an image, too large, or neither 8 nor 16 bits deep.
    """
    return _eight_bits(_in_channels(path, _stored_pixels(path), 1))


def read_colour(path: Path) -> ColourImage:
    """Return an image file as 8-bit colour of shape (h, w, 3), blue first as OpenCV has it; grey in equal channels.

    Alpha, depth and orientation are treated as by `read_grey`, which says what is raised.
    """
    return _eight_bits(_in_channels(path, _stored_pixels(path), 3))


def image_size(path: Path) -> tuple[int, int]:
    """Return (width, height) in pixels, from the header where the format has a simple one.

    Raises
    ------
    SequenceError
        The file is missing, empty, cut off, too large or not an image.
    """
    _check_regular(path)
    try:
        with path.open("rb") as file:
            head = file.read(_HEADER_BYTES)
            _check_not_empty(path, head)
            check_complete(path, file, path.stat().st_size)
    except OSError as error:
        raise _unreadable(path, error) from error
    size = _size_from_header(head) or _size_from_pillow(path) or tuple(read_grey(path).shape[::-1])
    _check_size(path, size[0], size[1])
    return size[0], size[1]


def sharpness(grey: GreyImage) -> float:
    """Return the variance of the Laplacian, which falls with blur; comparable between images of one scene only."""
    return float(cv2.Laplacian(grey, cv2.CV_32F).var())


def _read_bytes(path: Path) -> bytes:
    _check_regular(path)
    try:
        data = path.read_bytes()
    except OSError as error:
        raise _unreadable(path, error) from error
    _check_not_empty(path, data)
    return data


def _check_regular(path: Path) -> None:
    """Refuse pipes and devices: reading one may never end."""
    try:
        if path.exists() and not path.is_file():
            raise SequenceError(f"{path}: expected an image file, found a folder, a pipe or a device; {_LEAVE_OUT}")
    except OSError as error:
        raise _unreadable(path, error) from error


def _unreadable(path: Path, error: OSError) -> SequenceError:
    return SequenceError(f"{path}: cannot read the image ({error.strerror}); check the path and its permissions")


def _check_not_empty(path: Path, data: bytes) -> None:
    if not data:
        raise SequenceError(f"{path}: the image file is empty; {_LEAVE_OUT}")


def _check_size(path: Path, width: int, height: int) -> None:
    if min(width, height) < 1:
        raise SequenceError(f"{path}: the image has no pixels ({width}x{height}); {_LEAVE_OUT}")
    if width * height > _MOST_PIXELS:
        raise SequenceError(
            f"{path}: expected at most {_MOST_PIXELS // 10**6} million pixels, found {width}x{height}; shrink the image"
        )


def _silence_opencv() -> None:
    if hasattr(cv2, "setLogLevel"):  # OpenCV 4
        cv2.setLogLevel(0)
    else:
        cv2.utils.logging.setLogLevel(cv2.utils.logging.LOG_LEVEL_SILENT)


def _decoded(path: Path, data: bytes) -> NDArray[np.generic]:
    """Return the pixels as they are stored, with channels in OpenCV's order."""
    if path.suffix.lower() in HEIF_SUFFIXES:
        return _decoded_heif(path, data)
    _silence_opencv()  # the error says what is wrong
    try:
        pixels = cv2.imdecode(np.frombuffer(_as_stored(data), dtype=np.uint8), cv2.IMREAD_UNCHANGED)
    except cv2.error as error:
        raise SequenceError(f"{path}: cannot be decoded as an image ({error.err}); {_LEAVE_OUT}") from error
    if pixels is None:
        raise SequenceError(f"{path}: cannot be decoded as an image; {_LEAVE_OUT}")
    return np.asarray(pixels)


def _decoded_heif(path: Path, data: bytes) -> NDArray[np.generic]:
    try:
        from pillow_heif import open_heif
    except ImportError as error:
        raise SequenceError(
            f"{path}: HEIC needs the package pillow-heif; install it with: pip install 'gtf-tune[heic]', convert the "
            "photographs, or leave them out with exclude"
        ) from error
    try:
        return np.asarray(open_heif(data, convert_hdr_to_8bit=False, bgr_mode=True))
    except (OSError, ValueError, RuntimeError, SyntaxError, EOFError) as error:
        raise SequenceError(f"{path}: cannot be decoded as an image ({error}); {_LEAVE_OUT}") from error


def _stored_pixels(path: Path) -> NDArray[np.generic]:
    data = _read_bytes(path)
    _check_size(path, *(_size_from_header(data[:_HEADER_BYTES]) or (1, 1)))
    check_complete(path, io.BytesIO(data), len(data))
    check_undamaged(path, data)
    return _decoded(path, data)


_CONVERSIONS = {
    1: {1: None, 3: cv2.COLOR_BGR2GRAY, 4: cv2.COLOR_BGRA2GRAY},
    3: {1: cv2.COLOR_GRAY2BGR, 3: None, 4: cv2.COLOR_BGRA2BGR},
}


def _in_channels(path: Path, pixels: NDArray[np.generic], channels: int) -> NDArray[np.generic]:
    """Return the pixels with 1 channel, of shape (h, w), or with 3."""
    if pixels.dtype not in (np.uint8, np.uint16):
        raise SequenceError(f"{path}: expected 8 or 16 bits per channel, not {pixels.dtype}; convert the image")
    stored = pixels.shape[2] if pixels.ndim == 3 else 1
    if stored not in _CONVERSIONS[channels]:
        raise SequenceError(f"{path}: expected 1, 3 or 4 channels, not {stored}; convert the image")
    pixels = pixels[..., 0] if pixels.ndim == 3 and stored == 1 else pixels
    code = _CONVERSIONS[channels][stored]
    return pixels if code is None else cv2.cvtColor(pixels, code)


def _eight_bits(pixels: NDArray[np.generic]) -> NDArray[np.uint8]:
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


def _size_from_pillow(path: Path) -> tuple[int, int] | None:
    """Return the size of the formats that are slow to decode, where the header says it."""
    if path.suffix.lower() not in LATER_SUFFIXES:
        return None
    try:
        if path.suffix.lower() in HEIF_SUFFIXES:
            from pillow_heif import open_heif

            width, height = open_heif(path).size
            return width, height
        with warnings.catch_warnings(), Image.open(path) as image:
            warnings.simplefilter("ignore")
            return image.size
    except (ImportError, OSError, ValueError, RuntimeError, SyntaxError, Image.DecompressionBombError):
        return None  # reading the pixels says what is wrong


def _size_from_header(head: bytes) -> tuple[int, int] | None:
    if head.startswith(b"\x89PNG") and len(head) >= 24:
        width, height = struct.unpack(">II", head[16:24])
        return width, height
    if head.startswith(b"\xff\xd8"):
        return _jpeg_size(head)
    return None


def _jpeg_size(head: bytes) -> tuple[int, int] | None:
    """Read the frame header (SOF0..SOF15 without DHT, JPG and DAC)."""
    for marker, at in jpeg_segments(head):
        if 0xC0 <= marker <= 0xCF and marker not in (0xC4, 0xC8, 0xCC):
            height, width = struct.unpack(">HH", head[at + 5 : at + 9])
            return width, height
    return None


_TAIL_BYTES = 1 << 16
_PNG = b"\x89PNG"
_PNG_FIRST_CHUNK = 8
_PNG_END = b"IEND"
_JPEG = b"\xff\xd8\xff"
_JPEG_END = b"\xff\xd9"
_JPEG_SCAN = 0xDA
_JPEG_KEPT = 0xEE  # Adobe's segment says what the channels are
_TIFF = (b"II*\x00", b"MM\x00*")
_TIFF_CHECKED = frozenset({"tiff_lzw", "packbits"})
_TIFF_DEFLATED = frozenset({"tiff_adobe_deflate", "tiff_deflate"})
_TIFF_PLACES = ((273, 279), (324, 325))  # offsets and lengths of strips and of tiles
_EXTRA_BYTES = re.compile(r"(\d+) extraneous bytes")
_FEW_BYTES = 8
_IMAGE_INTEGRITY_LEAVE_OUT = "replace the file, or leave it out with exclude"


def check_complete(path: Path, file: BinaryIO, size: int) -> None:
    """Raise `SequenceError` if a JPEG or PNG file of ``size`` bytes ends before its image does.

    Whatever follows the image does not matter: phones append the film of a motion photo.
    """
    file.seek(0)
    magic = file.read(4)
    file.seek(max(0, size - _TAIL_BYTES))
    tail = file.read()
    if magic.startswith(_JPEG):
        whole = _JPEG_END in tail or _jpeg_ends(file)
    else:
        whole = magic != _PNG or _PNG_END in tail or _png_ends(file, size)
    if not whole:
        raise SequenceError(f"{path}: the image file is cut off; {_IMAGE_INTEGRITY_LEAVE_OUT}")


def check_undamaged(path: Path, data: bytes) -> None:
    """Raise `SequenceError` if compressed pixels are damaged where a decoder would go on without a word."""
    reason = ""
    if data.startswith(_JPEG):
        reason = _jpeg_fault(data)
    if data[:4] in _TIFF:
        reason = _tiff_fault(data)
    if reason:
        raise SequenceError(f"{path}: the pixels are damaged ({reason}); {_IMAGE_INTEGRITY_LEAVE_OUT}")


def jpeg_segments(data: bytes) -> Iterator[tuple[int, int]]:
    """Yield the marker of each segment of a JPEG file and where it begins, up to the first scan."""
    at, marker = 2, 0
    while at + 9 <= len(data) and data[at] == 0xFF and marker != _JPEG_SCAN:
        marker = data[at + 1]
        if marker != 0xFF:  # more of them may stand before a marker
            yield marker, at
        at += 1 if marker == 0xFF else 2 + int(struct.unpack(">H", data[at + 2 : at + 4])[0])


def _jpeg_ends(file: BinaryIO) -> bool:
    file.seek(0)
    data = file.read()
    scan = next((at for marker, at in jpeg_segments(data) if marker == _JPEG_SCAN), len(data))
    return _JPEG_END in data[scan:]


def _png_ends(file: BinaryIO, size: int) -> bool:
    """Walk from chunk to chunk: length, type, data, checksum."""
    at = _PNG_FIRST_CHUNK
    while at + 12 <= size:
        file.seek(at)
        length, kind = struct.unpack(">I4s", file.read(8))
        at += 12 + length
        if kind == _PNG_END:
            return bool(at <= size)
    return False


def _jpeg_fault(data: bytes) -> str:
    """Return what libjpeg says of the compressed pixels, decoded to an eighth of the size."""
    try:
        simplejpeg.decode_jpeg(_pixels_only(data), "GRAY", min_height=1, min_width=1, min_factor=8)
    except ValueError as error:
        fault = str(error)
        return fault if "Corrupt JPEG data" in fault and not _only_padded(data, fault) else ""
    return ""


def _only_padded(data: bytes, fault: str) -> bool:
    """Return whether there are just bytes too many behind the pixels, as some cameras write them."""
    found = _EXTRA_BYTES.search(fault)
    if found is None:
        return False
    count, end = int(found[1]), data.rfind(_JPEG_END)
    return count <= _FEW_BYTES or len(set(data[max(0, end - count) : end])) == 1


def _pixels_only(data: bytes) -> bytes:
    """Return a JPEG file without its application segments, whose faults do no harm to pixels."""
    segments = list(jpeg_segments(data))
    if not segments or segments[-1][0] != _JPEG_SCAN:
        return data
    ends = [at for _, at in segments[1:]] + [len(data)]
    kept = (
        data[at:end]
        for (marker, at), end in zip(segments, ends, strict=True)
        if not 0xE0 <= marker <= 0xEF or marker == _JPEG_KEPT
    )
    return data[:2] + b"".join(kept)


def _deflate_fault(image: Image.Image, data: bytes) -> str:
    """Return what zlib says of the strips or tiles of a TIFF image; libtiff does not look at their checksums."""
    tags = getattr(image, "tag_v2", {})
    for offsets, lengths in _TIFF_PLACES:
        for at, length in zip(tags.get(offsets, ()), tags.get(lengths, ()), strict=False):
            try:
                zlib.decompress(data[at : at + length])
            except zlib.error as error:
                return str(error)
    return ""


def _tiff_fault(data: bytes) -> str:
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            image = Image.open(io.BytesIO(data))
            compression = image.info.get("compression")
            if compression in _TIFF_DEFLATED:
                return _deflate_fault(image, data)
            if compression in _TIFF_CHECKED:
                image.load()
    except (UnidentifiedImageError, Image.DecompressionBombError, SyntaxError):
        return ""  # none that Pillow knows; OpenCV decides
    except (OSError, ValueError, EOFError) as error:
        return str(error)
    return ""
