"""The examples of docs/pipelines.md work as they stand."""

import re
import sys
import tomllib
from importlib.util import module_from_spec, spec_from_file_location
from pathlib import Path
from types import ModuleType

import pytest

from gtf_tune.pipelines import ENTRY_POINT_GROUP
from gtf_tune.pipelines.command import create, preset_names
from gtf_tune.pipelines.command.definition import CommandDefinition
from gtf_tune.sequence import Sequence
from gtf_tune.testing import ContractCase, FolderStages, PipelineContract

PAGE = (Path(__file__).parents[2] / "docs" / "pipelines.md").read_text(encoding="utf-8")

SOLVER = """#!{python} -S
import sys
if sys.argv[1:] == ["--version"]:
    print("solver 1.2")
    raise SystemExit
words = sys.argv[1:]
times = open(words[words.index("--times") + 1]).read().split()
open(words[words.index("--out") + 1], "w").writelines(f"{{time}} {{i}} 0 0 0 0 0 1\\n" for i, time in enumerate(times))
open({log!r}, "w").write(" ".join(words))
"""


def example(name: str) -> str:
    match = re.search(rf"<!-- example: {name} -->\n```\w+\n(.*?)```\n<!-- end -->", PAGE, re.DOTALL)
    assert match is not None, name
    return match[1]


@pytest.fixture(scope="module")
def module(tmp_path_factory: pytest.TempPathFactory) -> ModuleType:
    path = tmp_path_factory.mktemp("example") / "shift_odometry.py"
    path.write_text(example("pipeline"), encoding="utf-8")
    spec = spec_from_file_location("shift_odometry", path)
    assert spec is not None
    assert spec.loader is not None
    loaded = module_from_spec(spec)
    with pytest.MonkeyPatch.context() as patch:
        patch.setitem(sys.modules, "shift_odometry", loaded)
        spec.loader.exec_module(loaded)
        yield loaded


class TestShiftOdometry(PipelineContract):
    @pytest.fixture(scope="class")
    @classmethod
    def case(cls, module: ModuleType, scene: Sequence) -> ContractCase:
        return ContractCase(module.create({}), scene)


def test_the_example_pipeline_says_what_to_change(module: ModuleType, scene: Sequence, tmp_path: Path) -> None:
    with pytest.raises(Exception, match="lower 'min_response'"):
        ContractCase(module.create({}), scene, {"min_response": 1.0}).run(tmp_path, FolderStages(tmp_path / "stages"))


def test_the_entry_point_is_in_the_group_that_is_searched() -> None:
    points = tomllib.loads(example("entry-point"))["project"]["entry-points"][ENTRY_POINT_GROUP]

    assert points == {"shift-odometry": "my_package.shift_odometry:create"}


def test_the_example_test_is_python() -> None:
    compile(example("test"), "test_shift_odometry.py", "exec")


def test_the_example_definition_runs_its_program(scene: Sequence, tmp_path: Path) -> None:
    (tmp_path / "solver.toml").write_text(example("command"), encoding="utf-8")
    solver = tmp_path / "solver"
    solver.write_text(SOLVER.format(python=sys.executable, log=str(tmp_path / "log")))
    solver.chmod(0o755)
    pipeline = create({"definition": str(tmp_path / "solver.toml"), "program": str(solver)})

    options = {"max-error": 2.0, "refine": False}
    output = ContractCase(pipeline, scene).run(tmp_path / "run", FolderStages(tmp_path / "stages"), options)

    assert pipeline.version == "1.2"
    assert len(output.trajectory) == len(scene)
    called = (tmp_path / "log").read_text()
    assert " --focal 220.0 --seed 7 " in called
    assert called.endswith("trajectory.txt --max-error 2.0 --no-refine")


def test_every_preset_and_every_key_is_on_the_page() -> None:
    for name in (*preset_names(), *(set(CommandDefinition.model_fields) - {"description", "sources"})):
        assert f"`{name}`" in PAGE, name
