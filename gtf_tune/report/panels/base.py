"""What a panel is made of."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any

from gtf_tune.report.aligned_runs import ConfigurationRuns
from gtf_tune.report.drawing.markup import Html
from gtf_tune.report.study_data import StudyData

if TYPE_CHECKING:
    from gtf_tune.pipelines.colmap.clouds import SparseCloud


@dataclass(frozen=True, eq=False)
class Drawing:
    """Figure of a panel; ``name`` is its file name without ending, ``is_wide`` asks for the whole width."""

    name: str
    title: str
    figure: Any
    is_wide: bool = False


Block = Html | Drawing


@dataclass(frozen=True)
class Lengths:
    """How much a report shows at most before it thins out, cuts off or folds away.

    ``trajectory_points`` frames of a trajectory, ``log_lines`` lines of the log of a failed run, ``trial_rows`` trials.
    """

    trajectory_points: int = 300
    log_lines: int = 15
    trial_rows: int = 15


@dataclass(frozen=True, eq=False)
class ReportInput:
    """Everything that a report shows.

    ``snippets`` are texts to copy, by their label. ``configurations`` are the runs of nominal and of the recommended
    configuration, else of the best one, by sequence, in this order as far as they exist; ``logs`` are the logs of
    failed runs by their keys. ``expected_error`` is a sentence on what the improvement means for the true error;
    ``models`` are the sparse models that were made, by their titles, nominal first.
    """

    data: StudyData
    lengths: Lengths = field(default_factory=Lengths)
    snippets: Mapping[str, str] = field(default_factory=dict)
    configurations: Mapping[str, tuple[ConfigurationRuns, ...]] = field(default_factory=dict)
    logs: Mapping[str, str] = field(default_factory=dict)
    expected_error: str = ""
    models: "Mapping[str, SparseCloud]" = field(default_factory=dict)


@dataclass(frozen=True)
class Panel:
    """One part of a report: its title, the function that makes its content, and a sentence under the title.

    ``text`` is a function where the sentence depends on the study.
    """

    title: str
    blocks: Callable[[ReportInput], list[Block]]
    text: str | Callable[[StudyData], str] = ""

    def text_for(self, data: StudyData) -> str:
        """Return the sentence under the title."""
        return self.text if isinstance(self.text, str) else self.text(data)
