"""Names of images in lists that come from another machine."""

import json
import re
from pathlib import Path

import pytest

from gtf_tune.errors import SequenceError
from gtf_tune.sequence import load_sequence
from gtf_tune.sequence.layouts.tables import find_listed
from tests.sequence import miniatures

SOURCE = Path("list.txt")


@pytest.mark.parametrize(
    "name",
    [
        "images/0.png",
        "./images/0.png",
        "images\\0.png",
        ".\\images\\0.png",
        "..\\somewhere\\images\\0.png",
        "C:\\data\\walk\\images\\0.png",
        "C:/data/walk/images/0.png",
        "\\\\server\\share\\images\\0.png",
        "/home/somebody/walk/images/0.png",
        "../walk/images/0.png",
    ],
)
def test_an_image_is_found_by_the_last_parts_of_its_name(tmp_path, name):
    miniatures.images(tmp_path, ["images/0.png"])

    found = find_listed(tmp_path, name, SOURCE)

    assert found.resolve() == (tmp_path / "images" / "0.png").resolve()


def test_more_parts_of_a_name_decide_before_fewer(tmp_path):
    miniatures.images(tmp_path, ["0.png", "images/0.png"])

    assert find_listed(tmp_path, "C:\\walk\\images\\0.png", SOURCE) == tmp_path / "images" / "0.png"


def test_a_backslash_may_belong_to_a_name(tmp_path):
    miniatures.images(tmp_path, ["odd\\0.png", "odd/0.png"])

    assert find_listed(tmp_path, "odd\\0.png", SOURCE) == tmp_path / "odd\\0.png"


@pytest.mark.parametrize("name", ["", "  ", "a\0.png", "a" * 5000])
def test_what_is_no_name_is_refused(tmp_path, name):
    with pytest.raises(SequenceError, match=r"list\.txt: expected the name of an image"):
        find_listed(tmp_path, name, SOURCE)


@pytest.mark.parametrize("layout", ["eth3d-slam", "euroc", "icl-nuim", "vslam-lab", "nerf"])
def test_lists_of_windows_are_read_in_every_layout(tmp_path, layout):
    miniatures.LAYOUTS[layout](tmp_path)
    expected = [frame.path for frame in load_sequence(tmp_path).frames]
    for path in tmp_path.rglob("*"):
        if path.name in ("rgb.txt", "data.csv", "associations.txt", "rgb.csv", "transforms.json"):
            path.write_text(_with_backslashes(path))

    assert [frame.path.resolve() for frame in load_sequence(tmp_path).frames] == [path.resolve() for path in expected]


def _with_backslashes(path):
    if path.suffix == ".json":
        values = json.loads(path.read_text())
        for frame in values["frames"]:
            frame["file_path"] = "D:\\walk\\" + frame["file_path"].replace("/", "\\")
        return json.dumps(values)
    return path.read_text().replace("/", "\\")


def test_names_with_spaces_are_read_from_lists(tmp_path):
    miniatures.images(tmp_path, [f"rgb/image {n}.png" for n in range(4)])
    (tmp_path / "rgb.txt").write_text("".join(f"{n}.5 rgb/image {n}.png\n" for n in range(4)))

    assert [frame.path.name for frame in load_sequence(tmp_path).frames][-1] == "image 3.png"


def test_two_names_of_one_image_are_refused(tmp_path):
    miniatures.images(tmp_path, ["0.png"])
    (tmp_path / "rgb.txt").write_text("0.5 C:\\left\\0.png\n1.5 C:\\right\\0.png\n")

    with pytest.raises(SequenceError, match=r"rgb\.txt: lists the image 0\.png twice"):
        load_sequence(tmp_path)


@pytest.mark.parametrize("name", ["\n", "a\nb.png", "\x7f.png"])
def test_names_with_control_characters_are_refused_in_one_line(tmp_path, name):
    miniatures.nerf(tmp_path)
    path = tmp_path / "transforms.json"
    path.write_text(path.read_text().replace('"images/0.png"', json.dumps(name)))

    with pytest.raises(SequenceError, match=r"transforms\.json: expected the name of an image, found") as caught:
        load_sequence(tmp_path)
    assert not re.search(r"[\x00-\x1f\x7f]", str(caught.value))
