"""Settings of pipelines are checked by name and word, all faults at once."""

import struct
from pathlib import Path

import pytest

from gtf_tune.errors import DefinitionError
from gtf_tune.pipelines import create_pipeline
from gtf_tune.pipelines.options import Setting, read_settings

KNOWN = {"pairing": Setting("exhaustive", ("exhaustive", "sequential")), "rate": Setting("1")}


def test_defaults_fill_what_is_not_given() -> None:
    assert read_settings("p", KNOWN, {"pairing": "sequential"}) == {"pairing": "sequential", "rate": "1"}


def test_values_become_texts() -> None:
    assert read_settings("p", KNOWN, {"rate": 0.5})["rate"] == "0.5"
    assert read_settings("p", KNOWN, {"rate": True})["rate"] == "true"


def test_all_faults_are_named_at_once() -> None:
    with pytest.raises(DefinitionError, match=r"'p'.*'paring'; did you mean 'pairing'; .*'rate' must be a short value"):
        read_settings("p", KNOWN, {"paring": "exhaustive", "rate": [1]})


def test_words_are_checked() -> None:
    with pytest.raises(DefinitionError, match=r"must be one of exhaustive, sequential, not 'all'"):
        read_settings("p", KNOWN, {"pairing": "all"})


@pytest.mark.parametrize("name", ["glomap", "colmap"])
def test_missing_vocabulary_trees_are_named(name: str, tmp_path: Path) -> None:
    path = tmp_path / "tree.bin"

    with pytest.raises(DefinitionError, match=r"no vocabulary tree file at '.*tree\.bin'; nothing is downloaded"):
        create_pipeline(name, {"pairing": "sequential", "vocab_tree_path": path.as_posix()})


@pytest.mark.parametrize("head", [b"no tree at all", struct.pack("<iiii", 256, 0, 128, 0), b"\x02\0\0\0", b""])
def test_files_at_which_pycolmap_would_abort_are_refused(head: bytes, tmp_path: Path) -> None:
    path = tmp_path / "tree.bin"
    path.write_bytes(head)

    with pytest.raises(DefinitionError, match=r"tree\.bin' is no vocabulary tree of COLMAP 4.*vocab_tree_builder"):
        create_pipeline("colmap", {"pairing": "sequential", "vocab_tree_path": path.as_posix()})


def test_another_vocabulary_tree_at_the_same_place_is_another_setting(tmp_path: Path) -> None:
    path = tmp_path / "tree.bin"
    found = []
    for content in (b"one", b"another"):
        path.write_bytes(struct.pack("<iii", 2, 0, 128) + content)
        found.append(create_pipeline("glomap", {"pairing": "sequential", "vocab_tree_path": path.as_posix()}).settings)

    assert found[0] != found[1]
    assert "vocab_tree" not in create_pipeline("glomap").settings


def test_camera_models_are_those_of_pycolmap() -> None:
    assert create_pipeline("glomap", {"camera_model": "OPENCV"}).settings["camera_model"] == "OPENCV"
    with pytest.raises(DefinitionError, match="OPENCV_FISHEYE"):
        create_pipeline("glomap", {"camera_model": "OPENVC"})
