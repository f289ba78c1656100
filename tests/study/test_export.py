import csv
import io

import pytest

from gtf_tune.definition import StudyDefinition, definition_from_dict
from gtf_tune.store.studies import StudySequence
from gtf_tune.study.outcome.export import common_camera, table_csv

KNOWN = "PINHOLE 500.0 500.0 32.0 24.0"


def test_a_cell_that_a_spreadsheet_would_compute_is_a_text_in_csv_and_numbers_stay_numbers() -> None:
    rows = [['=HYPERLINK("x")', "+1+1", "@cmd", "-x", -0.5, "-1.5e-3", "-", None, "cmd = 1"]]

    written = list(csv.reader(io.StringIO(table_csv(["a"] * 9, rows))))[1]

    assert written == ['\'=HYPERLINK("x")', "'+1+1", "'@cmd", "'-x", "-0.5", "-1.5e-3", "-", "", "cmd = 1"]


def defined(**selection: int) -> StudyDefinition:
    sequences = [{"name": "walk", "path": "walk", **selection}]
    return definition_from_dict(
        {"name": "any", "pipeline": {"name": "glomap"}, "sequences": sequences, "space": {"any": {"values": [1]}}}
    )


def seen_by(*cameras: str) -> list[StudySequence]:
    return [StudySequence("walk", "walk", "folder", "f", 9, 64, 48, camera, False) for camera in cameras]


@pytest.mark.parametrize(
    ("cameras", "words"),
    [
        ((KNOWN, KNOWN), KNOWN),
        (("unknown",), "unknown"),
        (("unknown", KNOWN), ""),
        ((KNOWN, "PINHOLE 1.0 1.0 2.0 2.0"), "known"),
    ],
)
def test_commands_get_the_camera_that_all_sequences_have(cameras: tuple[str, ...], words: str) -> None:
    assert common_camera(defined(), seen_by(*cameras)) == words


def test_intrinsics_of_reduced_images_are_not_given_for_the_whole_ones() -> None:
    assert common_camera(defined(max_image_size=100), seen_by(KNOWN)) == "known"
