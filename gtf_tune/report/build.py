"""Build a report from the database."""

from collections.abc import Mapping
from datetime import UTC, datetime
from pathlib import Path

from gtf_tune.display import count
from gtf_tune.errors import DefinitionError
from gtf_tune.report.definition import ReportDefinition
from gtf_tune.report.html import PageHead, Section, render_page
from gtf_tune.report.panels.blocks import ReportInput
from gtf_tune.report.panels.registry import PANELS
from gtf_tune.report.panels.runs import compared_trials
from gtf_tune.report.setting_runs import read_setting
from gtf_tune.report.study_data import StudyData, read_study
from gtf_tune.report.tables.failures import run_failures
from gtf_tune.report.tables.trajectories import SettingRuns
from gtf_tune.store.database import Database
from gtf_tune.store.runs import log
from gtf_tune.version import __version__


def build_report(
    database: Database, study_name: str, definition: ReportDefinition, snippets: Mapping[str, str] | None = None
) -> str:
    """Return the report of a study as one HTML page that works offline.

    ``snippets`` are texts that the reader may copy, by their label: the picked options in the forms that tools read.

    Raises
    ------
    StorageError
        There is no such study, or what is stored is damaged.
    """
    report = read_input(database, study_name, definition, snippets)
    return render_page(_head(report), build_sections(report))


def write_report(
    path: Path,
    database: Database,
    study_name: str,
    definition: ReportDefinition,
    snippets: Mapping[str, str] | None = None,
) -> None:
    """Write the report of a study to a file; see `build_report`.

    Raises
    ------
    StorageError
        There is no such study, or what is stored is damaged.
    DefinitionError
        The file cannot be written.
    """
    page = build_report(database, study_name, definition, snippets)
    try:
        path.write_text(page, encoding="utf-8")
    except OSError as error:
        raise DefinitionError(f"{path} cannot be written ({error.strerror}); give another file with -o") from error


def read_input(
    database: Database, study_name: str, definition: ReportDefinition, snippets: Mapping[str, str] | None = None
) -> ReportInput:
    """Return all that the report of a study shows."""
    data = read_study(database, study_name)
    failures = run_failures(data)
    return ReportInput(
        data=data,
        definition=definition,
        snippets=dict(snippets or {}),
        settings=read_settings(database, data),
        logs={one.example_key: log(database, one.example_key) for one in failures},
    )


def build_sections(report: ReportInput) -> list[Section]:
    """Return the panels of a report, in the order of its definition."""
    return [Section(one.kind, one.title, one.text, PANELS[one.kind](report)) for one in report.definition.panels]


def read_settings(database: Database, data: StudyData) -> dict[str, tuple[SettingRuns, ...]]:
    """Return the trajectories of the nominal and of the recommended trial, else the best one, by sequence."""
    by_trial = [
        read_setting(database, data, f"{name} (trial {ordinal})", ordinal) for name, ordinal in compared_trials(data)
    ]
    found = {one.name: tuple(runs[one.name] for runs in by_trial if one.name in runs) for one in data.sequences}
    return {name: settings for name, settings in found.items() if settings}


def _head(report: ReportInput) -> PageHead:
    data = report.data
    created = datetime.fromtimestamp(data.study.created_at, UTC).strftime("%Y-%m-%d")
    facts = (
        f"pipeline {data.definition.pipeline.name}",
        ", ".join(f"{one.name} ({count(one.num_frames, 'frame')})" for one in data.sequences),
        count(len(data.trials), "trial"),
        f"created {created}",
        f"study is {data.study.state}",
    )
    return PageHead(report.definition.title, data.study.name, facts, __version__)
