"""Read what cameras note in the EXIF of their photographs."""

import warnings
from collections import Counter
from collections.abc import Iterable
from dataclasses import dataclass

from PIL import ExifTags, Image, UnidentifiedImageError

from gtf_tune.sequence.value import Frame, Sequence

_UPRIGHT = 1
_NAMED = 3


@dataclass(frozen=True)
class ExifFacts:
    """What a camera notes of a photograph.

    ``orientation`` is 1 where upright, 0 where unknown; focal lengths are in mm, 0 where EXIF has none.
    """

    orientation: int = 0
    focal_mm: float = 0.0
    focal_35mm: float = 0.0
    make: str = ""
    model: str = ""


def exif_facts(frame: Frame) -> ExifFacts:
    """Return what the EXIF of a frame's file says; nothing where there is none that can be read."""
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            with Image.open(frame.path) as image:
                exif = image.getexif()
                details = exif.get_ifd(ExifTags.IFD.Exif)
    except (OSError, ValueError, SyntaxError, UnidentifiedImageError, Image.DecompressionBombError):
        return ExifFacts()
    return ExifFacts(
        orientation=int(_positive(exif.get(ExifTags.Base.Orientation))),
        focal_mm=_positive(details.get(ExifTags.Base.FocalLength)),
        focal_35mm=_positive(details.get(ExifTags.Base.FocalLengthIn35mmFilm)),
        make=_text(exif.get(ExifTags.Base.Make)),
        model=_text(exif.get(ExifTags.Base.Model)),
    )


def lens_of(frame: Frame) -> tuple[str, str, float]:
    """Return make, model and focal length in mm, by which COLMAP groups photographs; empty where EXIF has none.

    The orientation is no part of it: pixels are used as they are stored, which is as the sensor took them.
    """
    facts = exif_facts(frame)
    return facts.make, facts.model, facts.focal_35mm or facts.focal_mm


def exif_notes(sequence: Sequence) -> tuple[str, ...]:
    """Return notes on orientations that are not applied, and on focal lengths that differ between the images."""
    facts = [exif_facts(frame) for frame in sequence.frames]
    of_cameras: dict[int, list[ExifFacts]] = {}
    for number, fact in zip(sequence.taken_by, facts, strict=True):
        of_cameras.setdefault(number, []).append(fact)
    return (*_orientation_notes(facts), *(note for group in of_cameras.values() for note in _focal_notes(group)))


def _orientation_notes(facts: list[ExifFacts]) -> Iterable[str]:
    turned = Counter(fact.orientation for fact in facts if fact.orientation > _UPRIGHT)
    if turned:
        yield (
            f"EXIF asks to turn {turned.total()} of {len(facts)} images (orientation "
            f"{', '.join(str(value) for value in sorted(turned))}); pixels are used as they are stored"
        )


def _focal_notes(facts: list[ExifFacts]) -> Iterable[str]:
    lengths = Counter(fact.focal_35mm or fact.focal_mm for fact in facts if fact.focal_35mm or fact.focal_mm)
    if len(lengths) > 1:
        named = ", ".join(f"{value:g} mm ({count})" for value, count in lengths.most_common(_NAMED))
        more = ", ..." if len(lengths) > _NAMED else ""
        yield (
            f"EXIF has {len(lengths)} focal lengths ({named}{more}), but all {len(facts)} images are taken for those "
            "of one camera"
        )


def _text(value: object) -> str:
    return value.strip("\0 ") if isinstance(value, str) else ""


def _positive(value: object) -> float:
    """Return a number of EXIF, 0 where it is none or not above zero."""
    try:
        number = float(value)  # type: ignore[arg-type]  # a fraction, a number, or anything in damaged files
    except (TypeError, ValueError, ZeroDivisionError, OverflowError):
        return 0.0
    return number if 0 < number < float("inf") else 0.0
