"""What EXIF says of photographs is noted; their pixels stay as they are stored."""

import cv2
import numpy as np
import pytest
from PIL import ExifTags, Image, TiffImagePlugin

from gtf_tune.sequence import inspect_sequence, load_sequence
from gtf_tune.sequence.exif import ExifFacts, exif_facts, exif_notes


def photograph(path, number=0, size=(64, 48), **tags):
    """Write an image with EXIF; the tags are named as Pillow names them."""
    blocks = np.random.default_rng(number).integers(0, 255, (6, 8, 3), dtype=np.uint8)
    image = Image.fromarray(cv2.resize(blocks, size, interpolation=cv2.INTER_NEAREST))
    exif = Image.Exif()
    details = exif.get_ifd(ExifTags.IFD.Exif)
    for name, value in tags.items():
        target = exif if name in ("Orientation", "Make", "Model") else details
        target[getattr(ExifTags.Base, name)] = value
    path.parent.mkdir(parents=True, exist_ok=True)
    image.save(path, exif=exif)
    return path


def rational(value):
    return TiffImagePlugin.IFDRational(round(value * 1000), 1000)


def _sequence(folder, tags):
    for number, given in enumerate(tags):
        photograph(folder / f"{number}.jpg", number, **given)
    return load_sequence(folder)


def test_facts_are_read_where_there_are_any(tmp_path):
    tags = {"Orientation": 6, "FocalLength": rational(4.2), "FocalLengthIn35mmFilm": 26}
    sequence = _sequence(tmp_path, [tags, {}])

    assert exif_facts(sequence.frames[0]) == ExifFacts(6, 4.2, 26.0)
    assert exif_facts(sequence.frames[1]) == ExifFacts()


def test_an_orientation_is_noted_and_not_applied(tmp_path):
    sequence = _sequence(tmp_path, [{"Orientation": 6}, {"Orientation": 1}, {}, {"Orientation": 8}])

    assert (sequence.width, sequence.height) == (64, 48)
    assert exif_notes(sequence) == (
        "EXIF asks to turn 2 of 4 images (orientation 6, 8); pixels are used as they are stored",
    )


def test_focal_lengths_that_differ_are_noted(tmp_path):
    sequence = _sequence(tmp_path, [{"FocalLengthIn35mmFilm": value} for value in (26, 26, 52)])

    (note,) = exif_notes(sequence)

    assert note.startswith("EXIF has 2 focal lengths (26 mm (2), 52 mm (1))")
    assert note in inspect_sequence(sequence).notes


@pytest.mark.parametrize("value", [0, TiffImagePlugin.IFDRational(1, 0), "wide"])
def test_a_focal_length_that_is_none_is_left_alone(tmp_path, value):
    photograph(tmp_path / "0.jpg", FocalLength=value)
    sequence = load_sequence(tmp_path)

    assert exif_facts(sequence.frames[0]).focal_mm == 0
    assert exif_notes(sequence) == ()
