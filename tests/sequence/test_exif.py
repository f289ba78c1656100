"""What EXIF says of photographs is noted; their pixels stay as they are stored."""

import cv2
import numpy as np
import pytest
from PIL import ExifTags, Image, TiffImagePlugin

from gtf_tune.sequence import Selection, inspect_sequence, load_sequence
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


def test_photographs_are_grouped_by_make_model_focal_length_and_size(tmp_path):
    phone = {"Make": "Maker", "Model": "One", "FocalLengthIn35mmFilm": 26}
    tags = [phone, phone | {"Orientation": 6}, phone | {"FocalLengthIn35mmFilm": 52}, phone | {"Model": "Two"}, {}]
    for number, given in enumerate([*tags, phone | {"size": (48, 64)}, phone]):
        photograph(tmp_path / f"{number}.jpg", number, **given)

    sequence = load_sequence(tmp_path)

    assert sequence.taken_by == (0, 0, 1, 2, 3, 4, 0)
    assert [camera.size for camera in sequence.cameras] == [(64, 48)] * 4 + [(48, 64)]
    assert not any("focal lengths" in note for note in exif_notes(sequence))


def test_images_are_grouped_as_asked(tmp_path):
    for number in range(4):
        photograph(tmp_path / f"{number % 2}" / f"{number}.jpg", number, FocalLengthIn35mmFilm=20 + number)

    def taken_by(cameras):
        return load_sequence(tmp_path, selection=Selection(recursive=True, cameras=cameras)).taken_by

    assert taken_by("auto") == taken_by("per-image") == (0, 1, 2, 3)
    assert taken_by("per-folder") == (0, 0, 1, 1)
    assert taken_by("one") == (0, 0, 0, 0)


def test_focal_lengths_that_differ_are_noted_where_one_camera_is_asked_for(tmp_path):
    _sequence(tmp_path, [{"FocalLengthIn35mmFilm": value} for value in (26, 26, 52)])
    sequence = load_sequence(tmp_path, selection=Selection(cameras="one"))

    (note,) = exif_notes(sequence)

    assert note.startswith("EXIF has 2 focal lengths (26 mm (2), 52 mm (1))")
    assert note in inspect_sequence(sequence).notes


@pytest.mark.parametrize("value", [0, TiffImagePlugin.IFDRational(1, 0), "wide"])
def test_a_focal_length_that_is_none_is_left_alone(tmp_path, value):
    photograph(tmp_path / "0.jpg", FocalLength=value)
    sequence = load_sequence(tmp_path)

    assert exif_facts(sequence.frames[0]).focal_mm == 0
    assert exif_notes(sequence) == ()
