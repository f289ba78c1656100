"""Find images whose files are cut off or damaged, which decoders fill with grey and report as read."""

import io
import re
import struct
import warnings
import zlib
from collections.abc import Iterator
from pathlib import Path
from typing import BinaryIO

import simplejpeg
from PIL import Image, UnidentifiedImageError

from gtf_tune.errors import SequenceError

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
_LEAVE_OUT = "replace the file, or leave it out with exclude"


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
        raise SequenceError(f"{path}: the image file is cut off; {_LEAVE_OUT}")


def check_undamaged(path: Path, data: bytes) -> None:
    """Raise `SequenceError` if compressed pixels are damaged where a decoder would go on without a word."""
    reason = ""
    if data.startswith(_JPEG):
        reason = _jpeg_fault(data)
    if data[:4] in _TIFF:
        reason = _tiff_fault(data)
    if reason:
        raise SequenceError(f"{path}: the pixels are damaged ({reason}); {_LEAVE_OUT}")


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
