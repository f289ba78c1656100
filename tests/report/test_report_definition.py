import re
from pathlib import Path
from typing import get_args

import pytest

from gtf_tune.errors import DefinitionError
from gtf_tune.report.definition import PanelKind, default_report_definition, load_report_definition
from gtf_tune.report.panels.registry import PANELS

SHIPPED = Path(__file__).parents[2] / "dashboards" / "report.toml"


def test_the_shipped_definition_is_the_default_one() -> None:
    assert load_report_definition(SHIPPED) == default_report_definition()


def test_the_default_definition_shows_every_panel() -> None:
    shown = {panel.kind for panel in default_report_definition().panels}

    assert shown == set(get_args(PanelKind)) == set(PANELS)


def test_a_shorter_definition_chooses_and_orders_panels(tmp_path: Path) -> None:
    path = tmp_path / "short.toml"
    path.write_text('[[panels]]\nkind = "trials"\ntitle = "All"\n[[panels]]\nkind = "verdict"\ntitle = "What now?"\n')

    definition = load_report_definition(path)

    assert [(panel.kind, panel.title) for panel in definition.panels] == [("trials", "All"), ("verdict", "What now?")]


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
