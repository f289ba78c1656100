"""The camera of photographs is read from the database that COLMAP keeps beside them."""

import sqlite3
import struct
from contextlib import closing

import pytest

from gtf_tune.pipelines import create_pipeline, with_focal_prior
from gtf_tune.sequence import Camera, Selection, load_sequence
from gtf_tune.sequence.camera import MODEL_PARAMS
from tests.sequence import miniatures

NAMES = [f"{n}.png" for n in range(miniatures.COUNT)]
CALIBRATED = ("OPENCV", (50.0, 51.0, 32.5, 24.0, 0.1, 0.0, 0.0, 0.0))
FROM_EXIF = ("SIMPLE_RADIAL", (50.0, 32.0, 24.0, 0.0))


def write_database(path, *cameras, names=NAMES, size=(64, 48), prior=1):
    """Write what COLMAP 4 keeps of cameras and images; the images take the cameras in turn."""
    with closing(sqlite3.connect(path)) as connection, connection:
        connection.execute("PRAGMA journal_mode=WAL")
        connection.execute("CREATE TABLE cameras (camera_id, model, width, height, params BLOB, prior_focal_length)")
        connection.execute("CREATE TABLE images (image_id, name TEXT UNIQUE, camera_id)")
        for number, (model, params) in enumerate(cameras):
            blob = struct.pack(f"<{len(params)}d", *params)
            row = (number, list(MODEL_PARAMS).index(model), *size, blob, prior)
            connection.execute("INSERT INTO cameras VALUES (?, ?, ?, ?, ?, ?)", row)
        rows = [(number, name, number % len(cameras)) for number, name in enumerate(names)]
        connection.executemany("INSERT INTO images VALUES (?, ?, ?)", rows)


@pytest.fixture
def photographs(tmp_path):
    miniatures.folder(tmp_path / "images")
    return tmp_path / "images"


@pytest.mark.parametrize("place", ["images/database.db", "database.db"])
def test_a_calibrated_camera_is_known(photographs, place):
    write_database(photographs.parent / place, CALIBRATED)

    sequence = load_sequence(photographs)

    assert sequence.camera == Camera("OPENCV", 64, 48, CALIBRATED[1])
    assert sequence.notes == ("intrinsics come from database.db, as COLMAP was given them",)


def test_a_camera_for_larger_images_is_scaled(photographs):
    large = ("PINHOLE", (100.0, 102.0, 64.0, 48.0))
    write_database(photographs / "database.db", large, size=(128, 96))

    assert load_sequence(photographs).camera == Camera("PINHOLE", 64, 48, (50, 51, 32, 24))


def test_a_mere_focal_length_is_where_the_pipeline_starts_from(photographs):
    write_database(photographs / "database.db", FROM_EXIF)

    sequence = load_sequence(photographs, selection=Selection(max_image_size=32))

    assert (sequence.camera, sequence.focal_prior) == (None, pytest.approx(25.0))
    assert sequence.notes[0].startswith("database.db has only a focal length, 50 pixels")
    assert with_focal_prior(sequence, create_pipeline("glomap")).focal_prior == pytest.approx(25.0)
    assert with_focal_prior(sequence, create_pipeline("analytic")).focal_prior is None
    assert with_focal_prior(sequence.with_prior(None), create_pipeline("glomap")).focal_prior is None


@pytest.mark.parametrize(
    ("given", "note"),
    [
        ({"prior": 0}, "has a camera without a focal length of its own"),
        ({"names": ["a.png", "b.png"]}, "cannot be used (it has 2 images, but none of these)"),
        ({"size": (48, 64)}, "cannot be used (the intrinsics are for 48x64 images"),
        ({"size": (-1, 2**60)}, "cannot be used (a camera needs an image size"),
    ],
)
def test_what_a_database_does_not_say_is_noted(photographs, given, note):
    write_database(photographs / "database.db", CALIBRATED, **given)

    sequence = load_sequence(photographs)

    assert (sequence.camera, sequence.focal_prior, len(sequence)) == (None, None, miniatures.COUNT)
    assert sequence.notes[0].startswith(f"database.db {note}")
    assert sequence.notes[0].endswith(": intrinsics count as unknown")


def test_each_image_has_its_camera_of_the_database(photographs):
    write_database(photographs / "database.db", CALIBRATED, FROM_EXIF)

    sequence = load_sequence(photographs)

    assert sequence.taken_by == tuple(n % 2 for n in range(miniatures.COUNT))
    assert [(camera.intrinsics, camera.focal_prior) for camera in sequence.cameras] == [
        (Camera("OPENCV", 64, 48, CALIBRATED[1]), None),
        (None, 50.0),
    ]
    assert sequence.notes == ("2 cameras come from database.db, 1 of them with known intrinsics",)


@pytest.mark.parametrize("content", [b"", b"1 2 3", b"SQLite format 3\0" + bytes(100)])
def test_another_file_of_that_name_does_not_matter(photographs, content):
    (photographs / "database.db").write_bytes(content)

    assert load_sequence(photographs).notes[0].startswith("database.db cannot be used (")
    assert load_sequence(photographs, camera="unknown").notes == ()


def test_the_folder_is_left_as_it_is(photographs):
    write_database(photographs / "database.db", CALIBRATED)
    before = sorted(photographs.iterdir())

    load_sequence(photographs)

    assert sorted(photographs.iterdir()) == before
