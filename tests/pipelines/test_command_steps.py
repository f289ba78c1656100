"""Steps of a definition: what a cached one depends on."""

import sys
from collections.abc import Mapping
from pathlib import Path

import pytest

from gtf_tune.pipelines.analytic import imaginary_sequence
from gtf_tune.pipelines.command import create
from gtf_tune.testing import ContractCase, FolderStages


def test_a_cached_step_does_not_depend_on_options_in_a_settings_file_of_another(
    tmp_path: Path, capfd: pytest.CaptureFixture[str]
) -> None:
    (tmp_path / "template.yaml").write_text("size: 1\n")
    code = """
import sys
step, settings, output = sys.argv[1:]
print("ran", step, open(settings).read().strip())
open(output, "w").write("0 0 0 0 0 0 0 1\\n")
"""
    (tmp_path / "program.py").write_text(code)
    names = ("match", "map")
    pipeline = create(
        {
            "steps": [
                {
                    "name": name,
                    "cached": name == "match",
                    "arguments": [
                        sys.executable,
                        "-I",
                        "-S",
                        str(tmp_path / "program.py"),
                        name,
                        f"{{settings_file:{name}}}",
                        "{output}",
                    ],
                }
                for name in names
            ],
            "settings_files": [
                {"name": name, "template": str(tmp_path / "template.yaml"), "path": f"{name}.yaml", "step": name}
                for name in names
            ],
            "options": {f"{n}_size": {"default": 1, "step": n, "key": "size", "file": n} for n in names},
            "output": {"association": "index"},
        }
    )
    case, stages = ContractCase(pipeline, imaginary_sequence(2)), FolderStages(tmp_path / "stages")

    def ran(number: int, options: Mapping[str, int]) -> list[str]:
        case.run(tmp_path / f"run{number}", stages, options)
        return [line[4:] for line in capfd.readouterr().out.splitlines() if line.startswith("ran ")]

    assert ran(0, {}) == ["match size: 1", "map size: 1"]
    assert ran(1, {"map_size": 5}) == ["map size: 5"]
    assert ran(2, {"match_size": 5}) == ["match size: 5", "map size: 1"]
