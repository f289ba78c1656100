"""What work on a sequence says first: its notes, and what is odd about its camera."""

from dataclasses import replace

import pytest

from gtf_tune.sequence import Camera, load_sequence, say_notes
from tests.sequence import miniatures


@pytest.mark.parametrize(
    ("known", "line"),
    [
        ((None, None), "note: intrinsics are unknown; the pipeline estimates them"),
        (
            (None, 51.25),
            "note: intrinsics are unknown; the pipeline starts from a focal length of 51.25 pixels",
        ),
        (
            (Camera("PINHOLE", 64, 48, (0.8, 1.06, 32, 24)), None),
            "note: a field of view of 177 degrees is unusual: check whether the intrinsics belong to these images",
        ),
        (
            (Camera("PINHOLE", 64, 48, (50, 51, 0.5, 0.5)), None),
            "note: the principal point is far from the centre: check whether the intrinsics belong to these images",
        ),
    ],
)
def test_what_is_odd_about_the_camera_is_said(tmp_path, known, line):
    miniatures.tum(tmp_path)
    said = []

    say_notes(load_sequence(tmp_path).with_camera(known[0]).with_prior(known[1]), said.append)

    assert said == [line]


def test_nothing_is_said_of_a_sound_sequence_and_notes_name_theirs(tmp_path):
    miniatures.tum(tmp_path)
    sequence, said = load_sequence(tmp_path, name="walk"), []

    say_notes(sequence, said.append, named=True)
    say_notes(replace(sequence, notes=("odd", "odder")), said.append, named=True)

    assert said == ["note: sequence 'walk': odd", "note: sequence 'walk': odder"]
