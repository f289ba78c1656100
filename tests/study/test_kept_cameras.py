"""A study keeps the frames, the intrinsics and the focal length that it began with, whatever its files say later."""

import json
from pathlib import Path

import numpy as np
import pytest

from gtf_tune.errors import SequenceError
from gtf_tune.sequence import Camera
from gtf_tune.store import studies
from gtf_tune.store.database import models
from gtf_tune.store.database.session import write
from gtf_tune.study.create import checked_definition, create_study
from gtf_tune.study.open_study import open_study
from tests.sequence import miniatures
from tests.sequence.test_colmap_database import write_database
from tests.sequence.test_exif import photograph
from tests.study.conftest import definition_of

KNOWN = Camera("PINHOLE", 20, 16, (18, 18, 10, 8))


def _create(database, folder, **sequence):
    data = definition_of(folder, sequences=[{"name": "room", "path": str(folder), **sequence}])
    return create_study(database, checked_definition(data, "test"), Path.cwd())


def _opened(database):
    study = open_study(database, "small")
    return study.sequences["room"], study.changes


def _store(database, **columns):
    def change(session):
        session.query(models.Sequence).update(columns)

    write(database, change)


def test_a_study_keeps_its_camera_and_says_that_the_files_differ(database, room):
    (room / "calibration.txt").write_text("18 18 9.5 7.5")
    _create(database, room)
    assert _opened(database) == (_Has(camera=KNOWN), ())

    (room / "calibration.txt").write_text("19 19 9.5 7.5")
    sequence, (change,) = _opened(database)

    assert sequence.camera == KNOWN
    assert change == (
        "sequence 'room' keeps the intrinsics that the study began with, PINHOLE 18.0 18.0 10.0 8.0, although its "
        "files now say PINHOLE 19.0 19.0 10.0 8.0"
    )


def test_a_database_that_colmap_leaves_behind_does_not_change_a_study(database, tmp_path):
    photographs = tmp_path / "photographs"
    miniatures.folder(photographs)
    _create(database, photographs)
    write_database(photographs / "database.db", ("SIMPLE_RADIAL", (50.0, 31.0, 24.0, 0.1)))

    sequence, (change,) = _opened(database)

    assert sequence.camera is None
    assert "began with, unknown, although its files now say SIMPLE_RADIAL 50.0" in change
    write_database(photographs / "other.db", ("SIMPLE_RADIAL", (50.0, 32.0, 24.0, 0.0)))
    (photographs / "other.db").replace(photographs / "database.db")
    sequence, changes = _opened(database)
    assert (sequence.camera, sequence.focal_prior, changes) == (None, None, ())


@pytest.mark.parametrize("content", ["nonsense", "1 2 3"])
def test_a_study_goes_on_where_the_calibration_cannot_be_read_any_more(database, room, content):
    (room / "calibration.txt").write_text("18 18 9.5 7.5")
    _create(database, room)
    (room / "calibration.txt").write_text(content)

    sequence, (change,) = _opened(database)

    assert sequence.camera == KNOWN
    assert "its files cannot be used any more" in change
    assert "calibration.txt" in change


def test_a_study_of_unknown_intrinsics_stays_one(database, room):
    _create(database, room)
    (room / "calibration.txt").write_text("18 18 9.5 7.5")

    sequence, (change,) = _opened(database)

    assert sequence.camera is None
    assert "began with, unknown, although its files now say PINHOLE 18.0" in change


@pytest.mark.parametrize("camera", ["unknown", {"model": "PINHOLE", "params": [18, 18, 10, 8]}])
def test_a_camera_of_the_definition_is_kept_without_a_word(database, room, camera):
    (room / "calibration.txt").write_text("nonsense")
    _create(database, room, camera=camera)
    (room / "calibration.txt").write_text("more nonsense")

    sequence, changes = _opened(database)

    assert (sequence.camera, changes) == (None if camera == "unknown" else KNOWN, ())


@pytest.mark.parametrize(("rules", "kept"), [(3, 9), (2, 5)])
def test_a_study_of_two_cameras_keeps_the_frames_of_its_rules(database, tmp_path, monkeypatch, rules, kept):
    names = [f"{n}.png" for n in range(9)]
    miniatures.images(tmp_path, [f"images/{name}" for name in names])
    pose = np.eye(4).tolist()
    frames = [
        {"file_path": f"images/{name}", "transform_matrix": pose, "fl_x": 50 + (n > 4)} for n, name in enumerate(names)
    ]
    (tmp_path / "transforms.json").write_text(json.dumps({"frames": frames}))
    monkeypatch.setattr("gtf_tune.study.open_study.LOADING_RULES", rules)
    _create(database, tmp_path)
    monkeypatch.undo()

    sequence, changes = _opened(database)

    assert (len(sequence), sequence.main_camera.intrinsics.params[0], changes) == (kept, 50, ())
    assert sequence.taken_by == ((0,) * 5 + (1,) * 4)[:kept]


def test_a_study_of_the_first_rules_keeps_all_frames(database, tmp_path):
    miniatures.images(tmp_path, [f"{n}.png" for n in range(5)])
    _create(database, tmp_path)
    _store(database, info={})
    miniatures.images(tmp_path, ["9.webp"])

    sequence, _ = _opened(database)

    assert [frame.path.name for frame in sequence.frames] == [f"{n}.png" for n in range(5)]


def test_other_pixels_are_refused_as_ever(database, room):
    _create(database, room)
    miniatures.images(room, ["rgb/000003.png"])

    with pytest.raises(SequenceError, match="expected 20x16"):
        _opened(database)


def test_the_prior_is_stored_at_creation_and_kept(database, tmp_path):
    for number in range(5):
        photograph(tmp_path / f"{number}.jpg", number, FocalLengthIn35mmFilm=28)
    data = definition_of(
        tmp_path, pipeline={"name": "glomap"}, space={"verification.ransac.max_error": {"low": 1, "high": 8}}
    )
    create_study(database, checked_definition(data, "test"), Path.cwd())
    began = _opened(database)[0].focal_prior

    assert began == pytest.approx(28 / 43.27 * 80)
    stored = studies.sequences(database, studies.get(database, "small").id)[0]
    assert (stored.camera, stored.info["focal_prior"]) == ("unknown", began)
    _store(database, info={})
    assert _opened(database)[0].focal_prior is None  # a study of before


class _Has:
    """Equal to whatever has these attributes."""

    def __init__(self, **attributes):
        self.attributes = attributes

    def __eq__(self, other):
        return all(getattr(other, name) == value for name, value in self.attributes.items())

    __hash__ = None
