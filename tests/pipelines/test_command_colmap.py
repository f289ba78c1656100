"""A real second program: COLMAP's own command line, where it is installed."""

import dataclasses
import re
import shutil
import subprocess
from pathlib import Path

import pytest

from gtf_tune.metrics import ate
from gtf_tune.pipelines.command import create, load_preset
from gtf_tune.sequence import Sequence
from gtf_tune.testing import ContractCase, FolderStages
from gtf_tune.trajectory import associate_by_frame_id, matched
from tests.pipelines.conftest import make_scene

COMMANDS = ("feature_extractor", "exhaustive_matcher", "mapper")


def installed_colmap() -> str:
    """Return the program, or an empty text where there is none whose options are those of version 3.8."""
    program = shutil.which("colmap")
    if program is None:
        return ""
    answer = subprocess.run([program, "-h"], capture_output=True, text=True, check=False)
    return program if re.search(r"COLMAP 3\.[5-8]\b", answer.stdout) else ""


pytestmark = pytest.mark.skipif(not installed_colmap(), reason="no COLMAP up to 3.8 is installed (Debian's colmap)")


def test_the_preset_has_the_programs_options_and_defaults(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("QT_QPA_PLATFORM", "offscreen")
    said: dict[str, str] = {}
    for command in COMMANDS:
        answer = subprocess.run([installed_colmap(), command, "-h"], capture_output=True, text=True, check=True)
        said |= dict(re.findall(r"--([A-Z]\w+\.\w+) arg \(=([^)]*)\)", answer.stdout + answer.stderr))

    options = load_preset("colmap-3.8")["options"]

    assert len(options) > 70
    assert {name: float(said[name]) for name in options} == {
        name: pytest.approx(float(option["default"])) for name, option in options.items()
    }


def test_colmaps_command_line_takes_the_images_of_two_cameras(tmp_path: Path) -> None:
    turned = make_scene(tmp_path, 5, turned=(1, 3))
    case = ContractCase(create({"preset": "colmap-3.8"}), turned)

    options = {"Mapper.init_min_num_inliers": 30, "Mapper.init_min_tri_angle": 5.0, "Mapper.min_model_size": 3}
    found = case.run(tmp_path / "run", FolderStages(tmp_path / "stages"), options).trajectory

    assert turned.ground_truth is not None
    assert len(found) == 5
    assert ate(turned.ground_truth, found) < 0.02


def test_colmaps_command_line_reconstructs_a_scene(scene: Sequence, tmp_path: Path) -> None:
    few = dataclasses.replace(scene, frames=scene.frames[:5])
    case, stages = ContractCase(create({"preset": "colmap-3.8"}), few), FolderStages(tmp_path / "stages")

    options = {"Mapper.init_min_num_inliers": 30, "Mapper.init_min_tri_angle": 5.0, "Mapper.min_model_size": 3}
    first = case.run(tmp_path / "first", stages, options)
    again = case.run(tmp_path / "again", stages, {**options, "Mapper.filter_max_reproj_error": 3.0})

    assert case.pipeline.version.startswith("3.")
    assert (again.diagnostics["features_cached"], again.diagnostics["matches_cached"]) == (True, True)
    assert scene.ground_truth is not None
    for output in (first, again):
        assert len(output.trajectory) == len(few)
        both = associate_by_frame_id(scene.ground_truth, output.trajectory)
        assert ate(*matched(scene.ground_truth, output.trajectory, both)) < 0.02
