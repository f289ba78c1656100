"""The studies that ship can be created as they stand, once their images are there."""

import tomllib
from pathlib import Path

import pytest

from gtf_tune.definition import StudyDefinition, definition_from_dict, load_definition
from gtf_tune.errors import DefinitionError
from gtf_tune.pipelines import OptionTable
from gtf_tune.pipelines.command import load_preset
from gtf_tune.pipelines.command.checks import read_command
from gtf_tune.pipelines.droid_slam.options import OPTIONS
from gtf_tune.store import studies
from gtf_tune.store.database import create_database
from gtf_tune.study.create import checked_definition, create_study
from gtf_tune.study.open_study import make_pipeline, open_study
from gtf_tune.study.search.space import space_faults
from tests.study.conftest import write_sequence

ROOT = Path(__file__).parents[2]
FOLDER = ROOT / "studies"
FILES = sorted(FOLDER.rglob("*.toml"))
DROID = "droid-slam"
COMMAND = "command"
ABLATION = sorted((FOLDER / "paper" / "ablation").glob("*.toml"))


@pytest.fixture(params=FILES, ids=lambda path: str(path.relative_to(FOLDER)))
def path(request: pytest.FixtureRequest) -> Path:
    return request.param


def test_there_are_studies() -> None:
    assert FILES


def options_of(definition: StudyDefinition) -> OptionTable:
    """Return the options of a definition's pipeline, whether or not its program is installed here."""
    if definition.pipeline.name == DROID:
        return OptionTable(DROID, OPTIONS)
    if definition.pipeline.name == COMMAND:
        preset, faults = read_command(load_preset(str(definition.pipeline.settings["preset"])))
        assert faults == []
        return OptionTable(COMMAND, preset.option_specs())
    return make_pipeline(definition).options


def test_options_and_axes_suit_the_pipeline(path: Path) -> None:
    definition = load_definition(path)

    options_of(definition).check(definition.pipeline.options)
    assert space_faults(definition.space, options_of(definition)) == []


def test_every_fault_would_be_named(path: Path) -> None:
    if load_definition(path).pipeline.name in (DROID, COMMAND):
        pytest.skip("this pipeline needs a program that is not part of gtf-tune")

    assert checked_definition(tomllib.loads(path.read_text()), path.name) == load_definition(path)


def test_nominal_values_lie_inside_the_ranges(path: Path) -> None:
    definition = load_definition(path)
    specs = options_of(definition).specs
    for name, axis in definition.space.items():
        if hasattr(axis, "low"):
            assert axis.low <= specs[name].default <= axis.high, name


def test_names_differ_and_follow_the_folder(path: Path) -> None:
    definition = load_definition(path)
    names = [load_definition(other).name for other in FILES]

    assert names.count(definition.name) == 1
    assert definition.name == "-".join(path.relative_to(FOLDER).with_suffix("").parts)


@pytest.mark.parametrize("folder", sorted({path.parent for path in FILES}), ids=lambda path: path.name)
def test_a_study_can_be_created_and_opened(folder: Path, tmp_path: Path) -> None:
    data = load_definition(min(folder.glob("*.toml"))).model_dump(mode="json")
    if data["pipeline"]["name"] in (DROID, COMMAND):
        pytest.skip("this pipeline needs a program that is not part of gtf-tune")
    for number, sequence in enumerate(data["sequences"]):
        write_sequence(tmp_path / sequence["name"], ground_truth=False, frames=8 + number)
        sequence.update(
            path=sequence["name"], layout="auto", start=None, stop=None, stride=None, max_frames=None, rate_hz=None
        )
    database = create_database(str(tmp_path / "studies.db"))

    create_study(database, definition_from_dict(data), tmp_path)

    assert studies.names(database) == [data["name"]]
    assert open_study(database, data["name"]).budget >= 2


def test_the_readme_names_every_folder_of_studies() -> None:
    readme = (FOLDER / "README.md").read_text()

    assert [path.name for path in FOLDER.iterdir() if path.is_dir() and f"`{path.name}/`" not in readme] == []


def test_each_of_the_papers_26_ablated_options_has_a_file_and_a_line_in_the_readme() -> None:
    readme = (FOLDER / "paper" / "README.md").read_text()

    assert [path.name[:3] for path in ABLATION] == [f"{number:02d}-" for number in range(1, 27)]
    for number, path in enumerate(ABLATION, start=1):
        (option,) = load_definition(path).space
        heading = path.read_text().splitlines()[0]
        assert heading.startswith(f"# GLOMAP ablation of the paper, {number} of 26: ")
        row = next(line for line in readme.splitlines() if line.startswith(f"| {number} | "))
        assert f"| {heading.split(chr(34))[1]} |" in row
        assert f"`{option}` | `{path.name}` |" in row


@pytest.mark.parametrize("path", ABLATION[4:7], ids=lambda path: path.stem)
def test_an_option_that_colmap_lost_is_told_so_and_needs_the_papers_program(
    path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("PATH", "/nowhere")

    assert "COLMAP 4 has no such option" in path.read_text()
    with pytest.raises(DefinitionError, match="there is no program 'glomap' that can be run; install it"):
        checked_definition(tomllib.loads(path.read_text()), path.name)


PAPER = sorted((FOLDER / "paper").rglob("*.toml"))


@pytest.mark.parametrize("path", PAPER, ids=lambda path: str(path.relative_to(FOLDER)))
def test_the_papers_studies_take_its_frames_its_score_and_its_baseline(path: Path) -> None:
    definition = load_definition(path)
    (sequence,) = definition.sequences
    gtf = definition.gtf

    assert (gtf.aggregate, gtf.normalise, gtf.common_noise) == ("mean", "none", False)
    assert sequence.max_frames == 50
    assert (sequence.rate_hz, sequence.stride) in ((3.0, None), (None, 10))
    if definition.pipeline.name == "glomap":
        assert definition.pipeline.nominal == {"mapper.bundle_adjustment.ceres.loss_function_scale": 0.1}
