"""Choose the figures that optuna-dashboard shows."""

from gtf_tune.report.definition import default_report_definition
from gtf_tune.report.panels.blocks import Drawing, ReportInput
from gtf_tune.report.panels.runs import matrices_panel
from gtf_tune.report.panels.scores import agreement_panel, options_panel
from gtf_tune.report.panels.search import coverage_panel
from gtf_tune.report.study_data import StudyData

_PANELS = (options_panel, agreement_panel, matrices_panel, coverage_panel)
_MOST_FIGURES = 10


def key_figures(data: StudyData) -> list[Drawing]:
    """Return the figures that need neither runs nor trajectories, the most telling first."""
    report = ReportInput(data, default_report_definition())
    drawings = [block for panel in _PANELS for block in panel(report) if isinstance(block, Drawing)]
    return drawings[:_MOST_FIGURES]
