"""Pipelines are found by name, and only imported when they are asked for."""

import subprocess
import sys
from pathlib import Path

import pytest

from gtf_tune.errors import DefinitionError
from gtf_tune.pipelines import create_pipeline, pipeline_names


@pytest.fixture
def third_party(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Install two pipelines of another package: one that works and one whose module is missing."""
    (tmp_path / "their_slam.py").write_text(
        "from gtf_tune.pipelines.analytic import AnalyticPipeline\n"
        "def create(settings):\n"
        "    return AnalyticPipeline('their-slam', '7', dict(settings))\n"
    )
    metadata = tmp_path / "their_slam-7.dist-info"
    metadata.mkdir()
    (metadata / "METADATA").write_text("Metadata-Version: 2.1\nName: their-slam\nVersion: 7\n")
    (metadata / "entry_points.txt").write_text(
        "[gtf_tune.pipelines]\ntheir-slam = their_slam:create\nbroken = their_missing_module:create\n"
        "glomap = their_slam:create\n"
    )
    monkeypatch.syspath_prepend(tmp_path)


def test_built_in_pipelines_are_listed() -> None:
    assert {"analytic", "colmap", "colmap-hierarchical", "glomap"} <= set(pipeline_names())


@pytest.mark.parametrize("name", ["analytic", "colmap", "colmap-hierarchical", "glomap"])
def test_pipelines_know_their_name(name: str) -> None:
    assert create_pipeline(name).name == name


def test_unknown_names_come_with_the_nearest_one() -> None:
    with pytest.raises(DefinitionError, match=r"unknown pipeline 'glomab'; did you mean 'glomap'"):
        create_pipeline("glomab")


def test_names_unlike_any_other_come_with_all_of_them() -> None:
    with pytest.raises(DefinitionError, match=r"is it one of .*colmap, .*glomap"):
        create_pipeline("zzzz")


@pytest.mark.usefixtures("third_party")
def test_other_packages_can_add_pipelines() -> None:
    pipeline = create_pipeline("their-slam", {"depth": "8"})

    assert "their-slam" in pipeline_names()
    assert (pipeline.name, pipeline.version, dict(pipeline.settings)) == ("their-slam", "7", {"depth": "8"})


@pytest.mark.usefixtures("third_party")
def test_other_packages_cannot_replace_built_in_pipelines() -> None:
    assert create_pipeline("glomap").name == "glomap"


@pytest.mark.usefixtures("third_party")
def test_pipelines_that_cannot_be_imported_say_why() -> None:
    with pytest.raises(DefinitionError, match=r"'broken' is offered by their_missing_module.* cannot be imported"):
        create_pipeline("broken")


def test_importing_the_package_does_not_import_pycolmap() -> None:
    code = "import sys, gtf_tune.pipelines as p; p.pipeline_names(); sys.exit('pycolmap' in sys.modules)"

    assert subprocess.run([sys.executable, "-c", code], check=False).returncode == 0
