"""The report of a study, built from the database."""

from collections.abc import Mapping
from dataclasses import dataclass, field
from datetime import UTC, datetime
from pathlib import Path
from typing import TYPE_CHECKING

from gtf_tune.display import count
from gtf_tune.errors import DefinitionError
from gtf_tune.report.aligned_runs import ConfigurationRuns, read_configuration
from gtf_tune.report.calibration import PIPELINE, cases, error_sentence
from gtf_tune.report.definition import PanelChoice, ReportDefinition
from gtf_tune.report.html import PageHead, Section, render_page
from gtf_tune.report.panels.base import ReportInput
from gtf_tune.report.panels.failures import run_failures
from gtf_tune.report.panels.registry import panel
from gtf_tune.report.panels.verdict import compared_trials
from gtf_tune.report.study_data import StudyData, read_study
from gtf_tune.store.database import Database
from gtf_tune.store.runs import log
from gtf_tune.version import __version__

if TYPE_CHECKING:
    from gtf_tune.pipelines.colmap.clouds import SparseCloud


@dataclass(frozen=True)
class Extras:
    """What a report shows besides the study.

    ``snippets`` are texts that the reader may copy, by their label: the picked options in the forms that tools read.
    ``models`` are sparse models by their titles, nominal first.
    """

    snippets: Mapping[str, str] = field(default_factory=dict)
    models: "Mapping[str, SparseCloud]" = field(default_factory=dict)


NO_EXTRAS = Extras()


def build_report(database: Database, study_name: str, definition: ReportDefinition, extras: Extras = NO_EXTRAS) -> str:
    """Return the report of a study as one HTML page that works offline.

    Raises
    ------
    StorageError
        There is no such study, or what is stored is damaged.
    """
    report = read_input(database, study_name, definition, extras)
    return render_page(_head(report.data, definition.title), build_sections(report, definition))


def write_report(
    path: Path, database: Database, study_name: str, definition: ReportDefinition, extras: Extras = NO_EXTRAS
) -> None:
    """Write the report of a study to a file; see `build_report`.

    Raises
    ------
    StorageError
        There is no such study, or what is stored is damaged.
    DefinitionError
        The file cannot be written.
    """
    page = build_report(database, study_name, definition, extras)
    try:
        path.write_text(page, encoding="utf-8", errors="backslashreplace")  # names of folders may be no UTF-8
    except OSError as error:
        raise DefinitionError(f"{path} cannot be written ({error.strerror}); give another file with -o") from error


def read_input(
    database: Database, study_name: str, definition: ReportDefinition, extras: Extras = NO_EXTRAS
) -> ReportInput:
    """Return all that the report of a study shows."""
    data = read_study(database, study_name)
    failures = run_failures(data)
    return ReportInput(
        data=data,
        lengths=definition.lengths,
        snippets=extras.snippets,
        configurations=read_configurations(database, data),
        logs={failure.example_key: log(database, failure.example_key) for failure in failures},
        expected_error=_expected_error(data),
        models=extras.models,
    )


def build_sections(report: ReportInput, definition: ReportDefinition) -> list[Section]:
    """Return the panels of a report that have something to show, in the order of its definition."""
    return [section for choice in definition.panels if (section := _section(choice, report)).blocks]


def read_configurations(database: Database, data: StudyData) -> dict[str, tuple[ConfigurationRuns, ...]]:
    """Return the trajectories of the compared trials, nominal first, by sequence."""
    by_trial = [
        read_configuration(database, data, f"{name} (trial {number})", number) for name, number in compared_trials(data)
    ]
    names = [sequence.name for sequence in data.sequences]
    found = {name: tuple(runs[name] for runs in by_trial if name in runs) for name in names}
    return {name: configurations for name, configurations in found.items() if configurations}


def _expected_error(data: StudyData) -> str:
    """Return what the improvement means for the true error by sequences whose ground truth is known, if anything."""
    found = data.recommendation
    is_measured = data.definition.pipeline.name == PIPELINE and data.definition.gtf.metric == "ate"
    return error_sentence(-found.improvement.value, cases()) if is_measured and found.improvement.is_known else ""


def _section(choice: PanelChoice, report: ReportInput) -> Section:
    found = panel(choice.kind)
    title = found.title if choice.title is None else choice.title
    text = found.text_for(report.data) if choice.text is None else choice.text
    return Section(choice.kind, title, text, found.blocks(report))


def _head(data: StudyData, title: str) -> PageHead:
    created = datetime.fromtimestamp(data.study.created_at, UTC).strftime("%Y-%m-%d")
    facts = (
        f"pipeline {data.definition.pipeline.name}",
        ", ".join(f"{sequence.name} ({count(sequence.num_frames, 'frame')})" for sequence in data.sequences),
        count(len(data.trials), "trial"),
        f"created {created}",
        f"study is {data.study.state}",
    )
    return PageHead(title, data.study.name, facts, __version__)
