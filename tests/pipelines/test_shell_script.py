"""The shell script names every path, and says what COLMAP's command line cannot set."""

import shlex
import subprocess
from pathlib import Path

from gtf_tune.pipelines.colmap.script import Photographs
from gtf_tune.pipelines.colmap.shell import colmap_shell_script
from gtf_tune.sequence import Camera

CAMERA = Camera("PINHOLE", 240, 180, (220.0, 221.0, 120.0, 90.0))
SET_BY_SHELL = {"mapper.bundle_adjustment.ceres.loss_function_scale": 0.2, "verification.min_num_inliers": 30}
NOT_SET_BY_SHELL = {"verification.min_inlier_ratio": 0.25}


def commands(text: str) -> dict[str, dict[str, str]]:
    """Return the flags of every COLMAP command in a script."""
    lines = text.replace("\\\n", " ").splitlines()
    found = [shlex.split(line) for line in lines if line.startswith("colmap ")]
    return {words[1]: dict(zip(words[2::2], words[3::2], strict=True)) for words in found}


def test_every_command_has_its_paths_and_options() -> None:
    photographs = Photographs(Path("/my photos"), ["a.jpg"], (CAMERA,))

    found = commands(colmap_shell_script("glomap", photographs, {}, SET_BY_SHELL))

    assert list(found) == ["feature_extractor", "exhaustive_matcher", "global_mapper"]
    assert found["feature_extractor"]["--image_path"] == "/my photos"
    assert found["feature_extractor"]["--image_list_path"] == "images.txt"
    assert found["feature_extractor"]["--ImageReader.camera_params"] == "220.0,221.0,120.0,90.0"
    assert found["exhaustive_matcher"]["--TwoViewGeometry.min_num_inliers"] == "30"
    assert found["global_mapper"]["--GlobalMapper.ba_ceres_loss_function_scale"] == "0.2"
    assert {flags["--database_path"] for flags in found.values()} == {"database.db"}


def test_the_view_graph_is_calibrated_only_where_the_intrinsics_are_unknown() -> None:
    unknown = Photographs(Path("/photos"), [], (None,))

    assert "view_graph_calibrator" in commands(colmap_shell_script("glomap", unknown, {}, {}))
    assert "view_graph_calibrator" not in commands(colmap_shell_script("colmap", unknown, {}, {}))


def test_what_the_command_line_cannot_set_is_said() -> None:
    text = colmap_shell_script("glomap", Photographs(Path("/photos"), [], (CAMERA,)), {}, NOT_SET_BY_SHELL)

    assert "# COLMAP's command line cannot set verification.min_inlier_ratio = 0.25; run.py does" in text


def test_a_shell_reads_the_script(tmp_path: Path) -> None:
    text = colmap_shell_script("colmap", Photographs(Path('/it\'s "here"'), [], (CAMERA,)), {}, SET_BY_SHELL)
    (tmp_path / "run.sh").write_text(text)
    (tmp_path / "colmap").write_text('#!/bin/sh\nprintf "%s\\n" "$@" >> "$CALLS"\n')
    (tmp_path / "colmap").chmod(0o755)

    environment = {"PATH": f"{tmp_path}:/usr/bin:/bin", "CALLS": str(tmp_path / "calls")}
    subprocess.run(["sh", "run.sh", "models"], check=True, cwd=tmp_path, env=environment)

    calls = (tmp_path / "calls").read_text().splitlines()
    assert 'it\'s "here"' in " ".join(calls)
    assert [line for line in calls if line in ("feature_extractor", "exhaustive_matcher", "mapper")] == [
        "feature_extractor",
        "exhaustive_matcher",
        "mapper",
    ]
    assert (tmp_path / "models").is_dir()


def test_without_known_images_the_script_takes_their_folder_as_an_argument(tmp_path: Path) -> None:
    settings = {"pairing": "sequential", "camera_model": "OPENCV", "vocab_tree_path": "/my trees/a.bin"}
    options = {"sequential.loop_detection": True, "view_graph.max_calibration_error": 1.0}

    text = colmap_shell_script("glomap", None, settings, options)

    found = commands(text)
    assert list(found) == ["feature_extractor", "sequential_matcher", "view_graph_calibrator", "global_mapper"]
    assert found["feature_extractor"]["--image_path"] == "$images"
    assert found["sequential_matcher"]["--SequentialMatching.vocab_tree_path"] == "/my trees/a.bin"
    assert found["view_graph_calibrator"]["--max_calibration_error"] == "1.0"
    assert "# only where the intrinsics are unknown" in text
    assert "# only where" not in colmap_shell_script("glomap", None, settings, options, "unknown")
    refused = subprocess.run(["sh", "-c", text], check=False, cwd=tmp_path, capture_output=True, text=True)
    assert "give the folder of the images" in refused.stderr


def test_intrinsics_that_a_study_knows_are_given_and_nothing_calibrates_them() -> None:
    known = commands(colmap_shell_script("glomap", None, {}, {}, "PINHOLE 500.0 501.0 320.0 240.0"))
    elsewhere = colmap_shell_script("glomap", None, {}, {}, "known")

    assert known["feature_extractor"]["--ImageReader.camera_model"] == "PINHOLE"
    assert known["feature_extractor"]["--ImageReader.camera_params"] == "500.0,501.0,320.0,240.0"
    assert "view_graph_calibrator" not in known
    assert "view_graph_calibrator" not in commands(elsewhere)
    assert "# the intrinsics are known; give those of the images at full size" in elsewhere


def test_flags_of_the_hierarchical_pipeline_go_to_its_own_command() -> None:
    options = {"clustering.leaf_max_num_images": 100, "mapper.init_min_tri_angle": 8.0}

    found = commands(colmap_shell_script("colmap-hierarchical", None, {}, options))

    assert found["hierarchical_mapper"]["--HierarchicalMapper.leaf_max_num_images"] == "100"
    assert found["hierarchical_mapper"]["--Mapper.init_min_tri_angle"] == "8.0"
