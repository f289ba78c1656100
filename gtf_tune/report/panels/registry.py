"""Find the panel of a kind."""

from collections.abc import Callable, Mapping
from types import MappingProxyType

from gtf_tune.report.definition import PanelKind
from gtf_tune.report.panels.blocks import Block, ReportInput
from gtf_tune.report.panels.operations import costs_panel, failures_panel, reproducibility_panel, timeline_panel
from gtf_tune.report.panels.runs import frames_panel, matrices_panel, trajectories_panel
from gtf_tune.report.panels.scores import agreement_panel, options_panel
from gtf_tune.report.panels.search import coverage_panel, search_panel, trials_panel
from gtf_tune.report.panels.verdict import verdict_panel

PANELS: Mapping[PanelKind, Callable[[ReportInput], list[Block]]] = MappingProxyType(
    {
        "verdict": verdict_panel,
        "options": options_panel,
        "agreement": agreement_panel,
        "trajectories": trajectories_panel,
        "matrices": matrices_panel,
        "frames": frames_panel,
        "search": search_panel,
        "trials": trials_panel,
        "coverage": coverage_panel,
        "failures": failures_panel,
        "costs": costs_panel,
        "timeline": timeline_panel,
        "reproducibility": reproducibility_panel,
    }
)
