"""Know the files of images by their names."""

from pathlib import Path

CLASSIC_SUFFIXES = frozenset({".bmp", ".jpeg", ".jpg", ".pgm", ".png", ".ppm", ".tif", ".tiff"})
"""Formats that every version has read; studies of the first versions took no others."""

HEIF_SUFFIXES = frozenset({".heic", ".heif"})
LATER_SUFFIXES = frozenset({".avif", ".jp2", ".webp"}) | HEIF_SUFFIXES
IMAGE_SUFFIXES = CLASSIC_SUFFIXES | LATER_SUFFIXES
IMAGE_KINDS = ", ".join(sorted(suffix[1:] for suffix in IMAGE_SUFFIXES))
"""The formats that are read, for messages."""

_RAW = ".3fr .arw .cr2 .cr3 .dng .erf .iiq .kdc .mef .mos .mrw .nef .nrw .orf .pef .raf .raw .rw2 .rwl .sr2 .srw .x3f"
RAW_SUFFIXES = frozenset(_RAW.split())
UNREAD_SUFFIXES = RAW_SUFFIXES | {".jxl", ".gif", ".exr", ".hdr", ".psd"}
"""Formats of photographs that are not read, so that a folder that holds them can say so."""


def is_image(path: Path) -> bool:
    """Return whether the name is that of an image; hidden files (as macOS leaves them) are not."""
    return path.suffix.lower() in IMAGE_SUFFIXES and not path.name.startswith(".")
