"""A pipeline is run once, and everything that it does can be seen afterwards."""

import json
import sys
from pathlib import Path

from tests.cli.conftest import Cli

PROGRAM = """
import json
import sys
out, images, shift = sys.argv[1], open(sys.argv[2]).read().split(), float(sys.argv[3])
print("saw", len(images), "images")
if shift > 5:
    sys.exit("shift is too large")
with open(out, "w") as file:
    for index in range(len(images) - 1):
        file.write(f"{index} {index * index} {shift * index} 0 0 0 0 1\\n")
"""
DEFINITION = """
arguments = [{python!r}, "-I", "-S", {program!r}, "{{output}}", "{{image_list}}", "{{option:shift}}"]
[output]
association = "index"
[options]
shift = {{ default = 1.0 }}
"""


def write_definition(folder: Path) -> str:
    (folder / "program.py").write_text(PROGRAM)
    text = DEFINITION.format(python=sys.executable, program=str(folder / "program.py"))
    (folder / "slam.toml").write_text(text)
    return "slam.toml"


def test_everything_that_a_program_does_is_shown_and_kept(cli: Cli, room: Path, tmp_path: Path) -> None:
    said = cli("pipeline", "try", write_definition(tmp_path), "-s", str(room), "-o", "shift=2", "--keep", "kept")

    frames = len(list((room / "rgb").iterdir()))
    assert said.code == 0, said.err
    assert f"saw {frames} images" in said.err
    assert f"+ {sys.executable} -I -S" in said.err
    assert "{option:shift} = 2.0" in said.err
    assert f"{frames - 1} of {frames}" in said.out
    assert "true ATE" in said.out
    assert list((tmp_path / "kept").rglob("work/output"))
    assert "saw" in (tmp_path / "kept" / "run.log").read_text()


def test_a_run_that_fails_says_why_and_where_its_files_are(cli: Cli, room: Path, tmp_path: Path) -> None:
    said = cli("pipeline", "try", write_definition(tmp_path), "-s", str(room), "-o", "shift=9", "--keep", "kept")

    assert said.code == 1
    assert "ended with exit code 1; its last words: shift is too large" in said.err
    assert f"its files are in {tmp_path / 'kept'}" in said.err
    assert "Traceback" not in said.err


def test_a_study_is_tried_with_the_options_that_it_fixes_and_paths_from_its_own_folder(
    cli: Cli, room: Path, tmp_path: Path
) -> None:
    write_definition(tmp_path)
    (tmp_path / "studies").mkdir()
    (tmp_path / "studies" / "a.toml").write_text(
        'name = "a"\n[pipeline]\nname = "command"\nsettings = {definition = "../slam.toml"}\noptions = {shift = 3.0}\n'
    )

    said = cli("pipeline", "try", "studies/a.toml", "-s", str(room), "--keep", "kept")

    assert said.code == 0, said.err
    assert "{option:shift} = 3.0" in said.err


def test_the_pipeline_of_a_study_can_be_tried(cli: Cli, room: Path, tmp_path: Path) -> None:
    (tmp_path / "study.toml").write_text('name = "a"\n[pipeline]\nname = "analytic"\n')

    said = cli("pipeline", "try", "study.toml", "-s", str(room), "--keep", "kept")

    assert said.code == 0, said.err
    assert "a trajectory" in said.out


def test_files_that_are_there_are_not_mixed_with_those_of_the_run(cli: Cli, room: Path, tmp_path: Path) -> None:
    (tmp_path / "kept").mkdir()
    (tmp_path / "kept" / "mine").touch()

    said = cli("pipeline", "try", "analytic", "-s", str(room), "--keep", "kept")

    assert said.code != 0
    assert "not empty; give a new one" in said.err


def test_the_list_of_pipelines_says_how_each_preset_was_tried(cli: Cli) -> None:
    said = cli("pipeline", "list", "--json")

    details = {row["name"]: row["detail"] for row in json.loads(said.out)}
    assert details["command, preset=colmap-3.8"] == "run here"
    assert "never run" in details["command, preset=dso"]
