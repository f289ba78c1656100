import re
from pathlib import Path

import pytest

from gtf_tune.errors import DefinitionError
from gtf_tune.report import panels
from gtf_tune.report.build import build_sections
from gtf_tune.report.definition import ReportDefinition, load_report_definition
from gtf_tune.report.drawing.markup import Html
from gtf_tune.report.panels import registry
from gtf_tune.report.panels.base import ReportInput
from gtf_tune.report.panels.registry import panel
from gtf_tune.report.study_data import StudyData

SHIPPED = Path(__file__).parents[2] / "dashboards" / "paper.toml"


def test_the_shipped_definition_is_valid() -> None:
    assert next(choice.kind for choice in load_report_definition(SHIPPED).panels) == "options"


def test_without_a_definition_every_panel_is_shown_under_its_own_title() -> None:
    shown = ReportDefinition().panels

    assert tuple(choice.kind for choice in shown) == registry.KINDS
    assert all(panel(choice.kind).title for choice in shown)


def test_every_module_of_a_panel_is_registered() -> None:
    modules = {path.stem for path in Path(str(panels.__file__)).parent.glob("*.py")}

    assert modules - {"__init__", "base", "registry"} == set(registry.KINDS)


def test_a_new_panel_is_one_file_and_one_line(data: StudyData, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (tmp_path / "weather.py").write_text(
        "from gtf_tune.report.drawing import markup\n"
        "from gtf_tune.report.panels.base import Panel\n"
        "PANEL = Panel('Weather', lambda report: [markup.paragraph(f'{len(report.data.trials)} sunny trials')])\n"
    )
    monkeypatch.setattr(panels, "__path__", [*panels.__path__, str(tmp_path)])
    monkeypatch.setattr(registry, "KINDS", (*registry.KINDS, "weather"))

    sections = build_sections(ReportInput(data), ReportDefinition())

    assert (sections[-1].kind, sections[-1].title) == ("weather", "Weather")
    assert sections[-1].blocks == [Html(f"<p>{len(data.trials)} sunny trials</p>")]


def test_a_shorter_definition_chooses_and_orders_panels(tmp_path: Path) -> None:
    path = tmp_path / "short.toml"
    path.write_text('[[panels]]\nkind = "trials"\ntitle = "All"\n[[panels]]\nkind = "verdict"\ntitle = "What now?"\n')

    definition = load_report_definition(path)

    assert [(choice.kind, choice.title) for choice in definition.panels] == [
        ("trials", "All"),
        ("verdict", "What now?"),
    ]


def test_title_and_text_of_a_definition_replace_those_of_the_panel(data: StudyData, tmp_path: Path) -> None:
    path = tmp_path / "own.toml"
    path.write_text('[[panels]]\nkind = "coverage"\ntitle = "Frames"\n[[panels]]\nkind = "frames"\ntext = ""\n')

    first, second = build_sections(ReportInput(data), load_report_definition(path))

    assert (first.title, first.text) == ("Frames", panel("coverage").text)
    assert (second.title, second.text) == (panel("frames").title, "")


@pytest.mark.parametrize(
    ("text", "fault"),
    [
        ('[[panels]]\nkind = "verdikt"\ntitle = "x"\n', "'panels.0.kind'"),
        ('[[panels]]\nkind = "verdict"\ntitle = "x"\ncolour = 1\n', "'panels.0.colour'"),
        ("panels = []\n", "'panels'"),
        ('[[panels]]\nkind = "trials"\ntitle = "x"\n[[panels]]\nkind = "trials"\ntitle = "y"\n', "not twice: trials"),
        ("panels = [\n", "not valid TOML"),
    ],
)
def test_a_wrong_definition_is_refused_with_its_fault(tmp_path: Path, text: str, fault: str) -> None:
    path = tmp_path / "report.toml"
    path.write_text(text)

    with pytest.raises(DefinitionError, match=re.escape(fault)):
        load_report_definition(path)


def test_a_missing_file_is_asked_for_by_what_it_should_hold(tmp_path: Path) -> None:
    with pytest.raises(DefinitionError, match="give the path of a report definition"):
        load_report_definition(tmp_path / "none.toml")
