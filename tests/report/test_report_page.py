import base64
import gzip
import importlib.util
import json
import re
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import plotly.io
import pytest
from plotly.offline import get_plotlyjs

from gtf_tune.errors import DefinitionError, StorageError
from gtf_tune.report import images
from gtf_tune.report.build import Extras, build_report, build_sections, read_input, write_report
from gtf_tune.report.definition import PanelChoice, ReportDefinition
from gtf_tune.report.drawing import theme
from gtf_tune.report.drawing.markup import figure_id
from gtf_tune.report.html import PageHead, figure_json, render_page
from gtf_tune.report.images import write_images
from gtf_tune.report.panels.base import Drawing, ReportInput
from gtf_tune.report.panels.registry import KINDS, panel
from gtf_tune.report.study_data import StudyData
from gtf_tune.store.database import Database

DEFINITION = ReportDefinition()
MEGABYTE = 10**6


@pytest.fixture(scope="module")
def page(database: Database) -> str:
    """Return the report of ``synthetic`` without plotly.js."""
    snippets = {"COLMAP flags": "colmap mapper --Mapper.max_reproj 0.002"}
    full = build_report(database, "synthetic", DEFINITION, Extras(snippets))
    assert len(full) < 3 * MEGABYTE
    return re.sub(r'<script>.*?</script>|<script type="text/plain".*?</script>', "", full, flags=re.DOTALL)


def test_the_verdict_stands_on_top_with_what_it_cost_and_what_to_copy(page: str) -> None:
    assert page.index("Trial 3 is the best so far; not confirmed yet") < page.index('id="options"')
    assert "1 min 56 s" in page
    assert "colmap mapper --Mapper.max_reproj 0.002" in page


def test_every_panel_is_there_under_its_title(page: str) -> None:
    for kind in set(KINDS) - {"models"}:
        title = f'<h2 id="{kind}-title">{panel(kind).title}</h2>'
        assert f'<section id="{kind}" aria-labelledby="{kind}-title">{title}' in page


def test_figures_are_data_in_the_page_and_need_no_network(page: str) -> None:
    specs = re.findall(r'<script type="application/json" id="([^"]+[.]json)">(.*?)</script>', page, flags=re.DOTALL)

    assert len(specs) >= 14
    assert all({"data", "layout"} <= json.loads(spec).keys() for _, spec in specs)
    assert "http://" not in page
    assert "https://" not in page


def test_the_headline_gives_the_change_in_values(page: str) -> None:
    assert '<code>filter.max_error</code>\n0.01\n<span aria-label="becomes" role="img"> → </span>' in page


def test_figures_and_tables_have_words_for_a_screen_reader(page: str) -> None:
    plots = re.findall(r'<div id="[^"]+" class="plot"[^>]*>', page)

    assert plots
    assert all('role="group"' in plot and 'aria-label="' in plot for plot in plots)
    assert page.count('class="table" tabindex="0" role="group" aria-label="') == page.count('class="table"')


def test_the_trials_table_gives_the_options_first(page: str) -> None:
    table = page[page.index('aria-label="Trials"') :]
    columns = re.findall(r'<th scope="col"[^>]*>([^<]+)', table[: table.index("</thead>")])

    assert columns[:5] == ["trial", "state", "max_error", "kernel", "GTF ATE"]


def test_plotly_is_packed_in_the_page(database: Database) -> None:
    full = build_report(database, "empty", DEFINITION)

    packed = re.search(r'<script type="text/plain" id="plotly">([^<]*)</script>', full)

    assert packed is not None
    assert gzip.decompress(base64.b64decode(packed.group(1))).decode() == get_plotlyjs()


def test_figures_have_six_digits(data: StudyData) -> None:
    drawn = theme.figure()
    drawn.add_scatter(x=[1 / 3, 2e-9 / 3], y=[1, 2])

    assert json.loads(figure_json(drawn))["data"][0]["x"] == [0.333333, 6.66667e-10]


def test_every_colour_of_text_and_lines_has_a_dark_counterpart() -> None:
    drawn = theme.figure(xaxis=theme.axis("x"))

    used = re.findall(r'"(?:color|gridcolor|linecolor|tickcolor|bgcolor|\w+_bgcolor)":"([^"]+)"', figure_json(drawn))
    assert used
    assert set(used) <= set(theme.DARK)


def test_a_report_of_500_trials_stays_below_six_megabytes(data: StudyData) -> None:
    many = with_trials(data, 500)

    page = render_page(PageHead("Tuning", "many", (), "1"), build_sections(ReportInput(many), DEFINITION))

    assert len(many.trials) == 500
    assert len(page.encode()) < 6 * MEGABYTE


def test_what_programs_printed_is_shown_but_never_executed(page: str) -> None:
    assert "F1123 Check failed: x &lt; 3 &lt;script&gt;alert(1)&lt;/script&gt;" in page
    assert "<script>alert" not in page


def test_failed_pruned_and_infeasible_trials_are_visible_as_such(page: str) -> None:
    for state in ("feasible", "infeasible", "pruned", "failed"):
        assert f'class="state {state}"' in page


def test_a_confirmed_study_says_adopt_and_why(
    own_database: Database, confirm_study: Callable[[Database, str], None]
) -> None:
    confirm_study(own_database, "adopt")

    page = build_report(own_database, "synthetic", DEFINITION)

    assert "Adopt the options of trial 3" in page
    assert "Under image noise the trajectory moves 31 % less." in page
    assert "GTF ATE -31.0 % (95 % interval -39.0 % to -22.0 %, 12 noisy runs) against nominal, on fresh noise." in page


def test_a_study_without_trials_says_so_in_every_panel(database: Database) -> None:
    sections = build_sections(read_input(database, "empty", DEFINITION), DEFINITION)

    assert not [block for section in sections for block in section.blocks if isinstance(block, Drawing)]
    assert all(section.blocks for section in sections)
    assert {section.kind for section in sections} == set(KINDS) - {"models", "agreement"}


def test_a_study_without_ground_truth_promises_nothing_that_needs_it(database: Database) -> None:
    page = build_report(database, "single", DEFINITION)

    assert "Does the score tell the truth" not in page
    assert "Green" not in page
    assert "Spearman" not in page
    assert "searches one option, so there is nothing to rank" in page
    assert "Nothing failed" in page


def test_several_sequences_have_figures_together_and_each(database: Database) -> None:
    sections = build_sections(read_input(database, "two", DEFINITION), DEFINITION)

    titles = [block.title for section in sections for block in section.blocks if isinstance(block, Drawing)]
    assert {f"filter.max_error ({scope})" for scope in ("all sequences", "walk", "room")} <= set(titles)
    assert "room, best (trial 3): top view" in titles


def test_names_of_figures_are_different_and_fit_for_files(database: Database) -> None:
    sections = build_sections(read_input(database, "two", DEFINITION), DEFINITION)

    names = [figure_id(one.name) for section in sections for one in section.blocks if isinstance(one, Drawing)]
    assert len(set(names)) == len(names)
    assert all(re.fullmatch(r"[A-Za-z0-9._-]+", name) for name in names)


def test_a_definition_chooses_the_panels(database: Database) -> None:
    short = ReportDefinition(panels=(PanelChoice(kind="trials", title="<All>"),))

    page = build_report(database, "synthetic", short)

    assert '<h2 id="trials-title">&lt;All&gt;</h2>' in page
    assert 'id="verdict"' not in page


def test_trials_beyond_the_first_rows_are_folded_away(database: Database) -> None:
    short = ReportDefinition(panels=(PanelChoice(kind="trials", title="Trials"),), trial_rows=4)

    assert "6 more trials" in build_report(database, "synthetic", short)


def test_an_unknown_study_is_an_error(database: Database) -> None:
    with pytest.raises(StorageError, match="there is no study 'synthetik'"):
        build_report(database, "synthetik", DEFINITION)


def test_a_report_that_cannot_be_written_is_an_error(database: Database, tmp_path: Path) -> None:
    with pytest.raises(DefinitionError, match="give another file with -o"):
        write_report(tmp_path / "missing" / "report.html", database, "empty", DEFINITION)


def test_images_are_drawn_at_the_size_of_their_figures(
    database: Database, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    asked: dict[str, list[object]] = {}
    monkeypatch.setattr(images, "require_kaleido", lambda: None)
    monkeypatch.setattr(plotly.io, "write_images", lambda **wishes: asked.update(wishes))
    short = ReportDefinition(panels=(PanelChoice(kind="search", title="Search"),))

    paths = write_images(tmp_path / "new", build_sections(read_input(database, "synthetic", short), short))

    assert [path.name for path in paths] == ["history.png", "parallel-coordinates.png", "importance.png"]
    assert asked["file"] == [str(path) for path in paths]
    assert asked["height"][:2] == [400, 440]


def test_images_without_a_browser_name_what_to_install(
    database: Database, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def fail(**_: object) -> None:
        raise RuntimeError("Kaleido requires Google Chrome")

    monkeypatch.setattr(images, "require_kaleido", lambda: None)
    monkeypatch.setattr(plotly.io, "write_images", fail)

    with pytest.raises(DefinitionError, match="install Chrome or Chromium"):
        write_images(tmp_path, build_sections(read_input(database, "synthetic", DEFINITION), DEFINITION))


def with_trials(data: StudyData, count: int) -> StudyData:
    """Return a study whose feasible trials are repeated under new numbers, each with runs of its own."""
    pattern = [trial for trial in data.trials if trial.state == "complete" and trial.feasible]
    copies = [replace(pattern[number % len(pattern)], number=number) for number in range(count)]
    originals = {number: pattern[number % len(pattern)].number for number in range(count)}
    runs = [
        replace(use, number=number, reused=False, run=replace(use.run, id=1000 * number + use.run.id))
        for number, original in originals.items()
        for use in data.runs
        if use.number == original
    ]
    return replace(
        data,
        trials=tuple(copies),
        details={number: data.details[original] for number, original in originals.items()},
        validations={number: data.validations[original] for number, original in originals.items()},
        runs=tuple(runs),
    )


def test_images_without_kaleido_name_what_to_install(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(importlib.util, "find_spec", lambda name: None)

    with pytest.raises(DefinitionError, match=re.escape("pip install 'gtf-tune[png]'")):
        write_images(tmp_path, [])
