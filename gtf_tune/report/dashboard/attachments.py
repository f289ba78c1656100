"""The figures and files that optuna-dashboard shows beside a study and its trials."""

import csv
import io
from collections.abc import Iterable, Sequence
from dataclasses import dataclass

from gtf_tune.display import sequence_unit, significant
from gtf_tune.report.aligned_runs import align_runs
from gtf_tune.report.configuration_runs import ConfigurationRuns
from gtf_tune.report.dashboard.trajectory_svg import trajectory_svg
from gtf_tune.report.details import sequence_detail
from gtf_tune.report.panels.base import Drawing, ReportInput
from gtf_tune.report.panels.registry import panel
from gtf_tune.report.points import study_points
from gtf_tune.report.study_data import StudyData

_PANELS = ("options", "agreement", "matrices", "coverage")
_MOST_FIGURES = 10


@dataclass(frozen=True)
class Attachment:
    """One file: its name as shown, its media type and its content."""

    name: str
    media_type: str
    content: bytes


def key_figures(data: StudyData) -> list[Drawing]:
    """Return the figures that need neither runs nor trajectories, the most telling first."""
    report = ReportInput(data)
    drawings = [block for kind in _PANELS for block in panel(kind).blocks(report) if isinstance(block, Drawing)]
    return drawings[:_MOST_FIGURES]


def matrix_table(data: StudyData, number: int) -> Attachment | None:
    """Return the errors between clean and noisy runs of one trial as CSV, None where it has none."""
    unit = sequence_unit(data.definition.gtf)
    rows: list[Sequence[object]] = []
    for sequence in data.sequences:
        detail = sequence_detail(data, number, sequence.name)
        for (i, j), value in _cells(detail.matrix):
            collapsed = "yes" if j < len(detail.collapsed) and detail.collapsed[j] else "no"
            reason = detail.pair_errors.get((i, j), "")
            rows.append((sequence.name, i, j, significant(value * unit.factor, 5), collapsed, reason))
    if not rows:
        return None
    columns = ("sequence", "clean run", "noisy run", f"error [{unit.symbol}]", "collapsed", "reason")
    return Attachment("matrix.csv", "text/csv", _csv(columns, rows))


def trial_table(data: StudyData) -> Attachment:
    """Return all trials as CSV."""
    points = study_points(data)
    options = list(data.definition.space)
    columns = ("trial", "state", points.unit.label, "low", "high", points.truth_label, "coverage", *options, "message")
    rows = [
        (
            point.number,
            point.state,
            *(significant(value, 6) for value in (point.value, point.low, point.high, point.ground_truth)),
            significant(point.coverage),
            *(point.options.get(option, "") for option in options),
            point.message,
        )
        for point in points.points
    ]
    return Attachment("trials.csv", "text/csv", _csv(columns, rows))


def trajectory_image(configuration: ConfigurationRuns, sequence: str) -> Attachment | None:
    """Return the runs of one trial on one sequence as an image, None where none has poses."""
    runs = align_runs(configuration)
    if not runs:
        return None
    return Attachment(f"{sequence}.svg", "image/svg+xml", trajectory_svg(runs, f"{sequence}, {configuration.title}"))


def failure_log(texts: Iterable[tuple[str, str]]) -> Attachment | None:
    """Return the logs of failed runs, each under the name of its run, None where nothing was printed."""
    logs = [f"=== {name} ===\n{log.rstrip()}\n" for name, log in texts if log.strip()]
    return Attachment("failed-runs.log", "text/plain", "\n".join(logs).encode()) if logs else None


def _cells(matrix: Iterable[Iterable[float]]) -> Iterable[tuple[tuple[int, int], float]]:
    return (((i, j), float(value)) for i, row in enumerate(matrix) for j, value in enumerate(row))


def _csv(columns: Sequence[str], rows: Iterable[Sequence[object]]) -> bytes:
    buffer = io.StringIO()
    writer = csv.writer(buffer, lineterminator="\n")
    writer.writerow(columns)
    writer.writerows(rows)
    return buffer.getvalue().encode()
