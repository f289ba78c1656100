"""Files that optuna-dashboard shows beside a study and its trials: tables, logs, trajectories as small images."""

import csv
import io
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from html import escape

import numpy as np

from gtf_tune.display import sequence_unit, significant
from gtf_tune.report.aligned_runs import AlignedRun, ConfigurationRuns, align_runs, known_errors
from gtf_tune.report.drawing import theme
from gtf_tune.report.panels.base import Drawing, ReportInput
from gtf_tune.report.panels.registry import panel
from gtf_tune.report.points import sequence_detail, study_points
from gtf_tune.report.study_data import StudyData
from gtf_tune.trajectory import FloatArray

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


_SIDE_PX = 480
_MARGIN_PX = 34
_LEVELS = 12
_MOST_POSES = 120
_HIGHEST_PERCENTILE = 98


def trajectory_svg(runs: Sequence[AlignedRun], title: str) -> bytes:
    """Return the runs seen from the top, noisy poses coloured by how far they moved; at least one run is given."""
    thinned = [run.thinned(_MOST_POSES) for run in runs]
    placed = _Frame.around(thinned)
    errors = known_errors(thinned)
    highest = float(np.percentile(errors, _HIGHEST_PERCENTILE)) if errors.size else 1.0
    parts = [
        f'<svg xmlns="http://www.w3.org/2000/svg" width="{_SIDE_PX}" height="{placed.height}" '
        f'viewBox="0 0 {_SIDE_PX} {placed.height}" font-family="Helvetica, Arial, sans-serif" font-size="13">',
        '<rect width="100%" height="100%" fill="white"/>',
        *(_line(placed.pixels(run.positions)) for run in thinned if run.kind == "clean"),
        *(_dots(placed.pixels(run.positions), run.errors / highest) for run in thinned if run.kind == "noisy"),
        f'<text x="10" y="20" fill="{theme.INK}">{escape(title)}</text>',
        f'<text x="10" y="{placed.height - 10}" fill="{theme.FAINT}">colour: moved by 0 to {significant(highest)} ‰ of '
        "extent</text></svg>",
    ]
    return "\n".join(parts).encode()


class _Frame:
    """Mapping of positions in extents to pixels, with the same scale along both axes."""

    def __init__(self, low: FloatArray, scale: float, height: int) -> None:
        self._low = low
        self._scale = scale
        self.height = height

    @classmethod
    def around(cls, runs: Sequence[AlignedRun]) -> "_Frame":
        positions = np.concatenate([run.positions[:, :2] for run in runs])
        low, sides = positions.min(axis=0), np.ptp(positions, axis=0)
        scale = (_SIDE_PX - 2 * _MARGIN_PX) / (float(sides.max()) or 1.0)
        return cls(low, scale, max(int(sides[1] * scale) + 2 * _MARGIN_PX + 10, 4 * _MARGIN_PX))

    def pixels(self, positions: FloatArray) -> FloatArray:
        pixels: FloatArray = (positions[:, :2] - self._low) * self._scale + _MARGIN_PX
        pixels[:, 1] = self.height - pixels[:, 1]
        return pixels


def _line(pixels: FloatArray) -> str:
    points = " ".join(f"{x:.1f},{y:.1f}" for x, y in pixels)
    return f'<polyline points="{points}" fill="none" stroke="rgb(150,160,170)" stroke-width="1.5"/>'


def _dots(pixels: FloatArray, shares: FloatArray) -> str:
    """Return the poses of one run, those of one colour in one path: lines of length 0 with round ends are dots."""
    colours = theme.sampled(theme.ERROR_SCALE, [level / (_LEVELS - 1) for level in range(_LEVELS)])
    levels = (np.clip(np.nan_to_num(shares), 0, 1) * (_LEVELS - 1)).round().astype(int)
    paths = []
    for level in np.unique(levels):
        path = "".join(f"M{x:.1f},{y:.1f}h0" for x, y in pixels[levels == level])
        paths.append(f'<path d="{path}" stroke="{colours[level]}" stroke-width="4" stroke-linecap="round"/>')
    return "".join(paths)
