"""Hold what panels are made of."""

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

from gtf_tune.report.definition import ReportDefinition
from gtf_tune.report.markup import Html
from gtf_tune.report.study_data import StudyData
from gtf_tune.report.tables.trajectories import SettingRuns


@dataclass(frozen=True, eq=False)
class Drawing:
    """Hold one figure of a panel; ``name`` is its file name without ending, ``is_wide`` asks for the whole width."""

    name: str
    title: str
    figure: Any
    is_wide: bool = False


Block = Html | Drawing


@dataclass(frozen=True, eq=False)
class ReportInput:
    """Hold all that a report shows.

    ``snippets`` are texts to copy, by their label. ``settings`` are the runs of the nominal and of the recommended
    setting, else the best one, by sequence, in this order as far as they exist; ``logs`` are the logs of failed runs by
    their keys.
    """

    data: StudyData
    definition: ReportDefinition
    snippets: Mapping[str, str] = field(default_factory=dict)
    settings: Mapping[str, tuple[SettingRuns, ...]] = field(default_factory=dict)
    logs: Mapping[str, str] = field(default_factory=dict)
