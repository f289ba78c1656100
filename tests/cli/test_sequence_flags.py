"""What a camera, patterns and subfolders by flags do in every command that reads a sequence."""

import json
from pathlib import Path

import cv2
import numpy as np
import pytest

from tests.cli.conftest import Cli
from tests.sequence.test_exif import photograph

CREATE = ("study", "create", "given", "-s", "room", "-p", "analytic", "-r", "robust.scale=0.1:10:log", "--trials", "2")
EVALUATE = ("evaluate", "room", "-p", "analytic", "-k", "1", "-K", "2", "-j", "1", "--json")


@pytest.fixture
def odd(room: Path) -> Path:
    """Return a sequence whose calibration cannot be read and of whose images one is odd."""
    (room / "calibration.txt").write_text("18 18 9.5 7.5 0.1 0.2\n")
    cv2.imwrite(str(room / "rgb" / "000003.png"), np.zeros((8, 8), np.uint8))
    return room


@pytest.mark.parametrize("command", [("sequence", "inspect", "room"), CREATE, EVALUATE])
def test_the_way_out_of_each_error_works_in_every_command(cli: Cli, odd: Path, command: tuple[str, ...]) -> None:
    first = cli(*command)
    second = cli(*command, "--camera", "PINHOLE,18,18,10,8")
    third = cli(*command, "--camera", "PINHOLE,18,18,10,8", "--exclude", "000003.*")

    assert (first.code, second.code, third.code) == (1, 1, 0)
    assert "give the camera" in first.err
    assert "leave it out with exclude" in second.err


def test_inspect_suggests_a_command_with_the_same_flags(cli: Cli, odd: Path) -> None:
    said = cli("sequence", "inspect", "room", "--camera", "unknown", "--exclude", "000003.*")

    assert "--exclude '000003.*' --camera unknown --range" in said.err


def test_a_study_keeps_what_the_flags_said(cli: Cli, odd: Path) -> None:
    cli(*CREATE, "--camera", "PINHOLE 18 18 10 8", "--exclude", "000003.*", "--exclude", "000004.*")

    (sequence,) = json.loads(cli("study", "show", "given", "--json").out)["definition"]["sequences"]

    assert sequence["camera"] == {"model": "PINHOLE", "params": [18, 18, 10, 8]}
    assert sequence["exclude"] == ["000003.*", "000004.*"]


@pytest.mark.parametrize("camera", ["PINHOLE", "18,18,10,8", "PINHOLE,a,b", "", "known"])
def test_a_wrong_camera_is_one_sentence(cli: Cli, room: Path, camera: str) -> None:
    refused = cli("sequence", "inspect", "room", "--camera", camera)

    assert refused.code == 1
    assert refused.err.count("\n") == 1


def test_subfolders_are_read_when_asked_for(cli: Cli, room: Path) -> None:
    (room / "rgb").rename(room.parent / "walk")
    (room.parent / "outer").mkdir()
    (room.parent / "walk").rename(room.parent / "outer" / "walk")

    refused = cli("sequence", "inspect", "outer")
    found = json.loads(cli("sequence", "inspect", "outer", "--recursive", "--json").out)

    assert "walk/ (12)" in refused.err
    assert found["frames"] == 12


def test_inspect_says_what_exif_is_used_for(cli: Cli, tmp_path: Path) -> None:
    for number in range(4):
        photograph(tmp_path / "walk" / f"{number}.jpg", number, FocalLengthIn35mmFilm=28, Orientation=6)

    said = cli("sequence", "inspect", "walk").out

    assert "glomap and colmap start from a focal length of" in " ".join(said.split())
    assert "EXIF asks to turn 4 of 4 images" in said
