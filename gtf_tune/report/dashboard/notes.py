"""Notes of studies and trials that optuna-dashboard shows, in Markdown whose layout no text of a user can change."""

import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from html import escape

import numpy as np

from gtf_tune.definition import RangeAxis
from gtf_tune.display import (
    UNKNOWN,
    ScoreUnit,
    count,
    definition_unit,
    interval,
    nominal_text,
    sequence_unit,
    share,
    significant,
    value_text,
)
from gtf_tune.report.aligned_runs import AlignedRun, ConfigurationRuns, align_runs, known_errors
from gtf_tune.report.drawing import theme
from gtf_tune.report.panels.base import Drawing, ReportInput
from gtf_tune.report.panels.failures import run_failures
from gtf_tune.report.panels.registry import panel
from gtf_tune.report.panels.verdict import verdict_facts, verdict_sentences
from gtf_tune.report.points import PointSet, TrialPoint, sequence_detail, study_points
from gtf_tune.report.study_data import StudyData
from gtf_tune.study.outcome.export import table_csv
from gtf_tune.study.outcome.improvement import Improvement
from gtf_tune.study.scoring.objective import penalty
from gtf_tune.trajectory import FloatArray

_WIDE_SPACE = "\u2003"


def inline_code(words: object) -> str:
    """Return a text as code within a line."""
    line = " ".join(str(words).split()).replace("`", "'").replace("|", "\\|")
    return f"`{line}`" if line else ""


def plain(words: object) -> str:
    """Return a text on one line without any meaning to Markdown."""
    line = " ".join(str(words).split())
    return "".join(f"\\{sign}" if sign in "\\`*_{}[]<>#|!" else sign for sign in line)


def table(columns: Sequence[str], rows: Iterable[Sequence[str]]) -> str:
    """Return a table of cells that are Markdown already; columns whose name starts with '>' are aligned right."""
    rules = ["---:" if name.startswith(">") else ":---" for name in columns]
    head = [name.removeprefix(">") for name in columns]
    return "\n".join([_row(head), f"| {' | '.join(rules)} |", *(_row(cells) for cells in rows)])


def _row(cells: Sequence[str]) -> str:
    # optuna-dashboard puts no space between the columns of a table.
    return "| " + " | ".join(f"{cell}{_WIDE_SPACE}" for cell in cells) + " |"


KEPT_BELOW = "*gtf-tune keeps everything above this line up to date; what you write below it is kept.*"

_LONGEST_REASON = 300
_FAULTS = 3


def study_note(data: StudyData, before: str = "") -> str:
    """Return the note of a study; what a user wrote below the line of the note ``before`` stays."""
    facts = verdict_facts(data)
    said = [*verdict_sentences(data, facts), *(fault.text[:_LONGEST_REASON] for fault in data.machine_faults[:_FAULTS])]
    sentences = [f"- {plain(sentence)}" for sentence in said]
    parts = [
        f"# {plain(facts.recommendation.headline)}",
        "\n".join(sentences),
        "## What is tuned",
        f"Pipeline {inline_code(data.definition.pipeline.name)}, {count(len(data.trials), 'trial')} so far.",
        _option_table(data, {change.option: change.chosen for change in facts.changes}),
        "## On what",
        _sequence_table(data),
        "## How to read it",
        _reading(data),
        "---",
        KEPT_BELOW,
    ]
    kept = before.partition(KEPT_BELOW)[2] if KEPT_BELOW in before else f"\n\n{before}" if before.strip() else ""
    return "\n\n".join(part for part in parts if part) + kept


def trial_note(data: StudyData, number: int) -> str:
    """Return the note of one trial: its score, its options beside nominal, what failed."""
    points = study_points(data)
    point = next(point for point in points.points if point.number == number)
    parts = [_score_line(point, points, data.improvement(number)), _changes(data, point)]
    if point.message:
        parts.append(f"**{plain(point.state)}**: {inline_code(point.message[:_LONGEST_REASON])}")
    failures = [failure for failure in run_failures(data) if number in failure.numbers]
    if failures:
        rows = [(str(failure.runs), inline_code(failure.reason[:_LONGEST_REASON])) for failure in failures]
        parts += ["**Failed runs**", table([">runs", "reason"], rows)]
    return "\n\n".join(parts)


def _score_line(point: TrialPoint, points: PointSet, improvement: Improvement) -> str:
    name = "nominal options" if point.number == 0 else f"trial {point.number}"
    facts = [f"**{name}**"]
    if math.isfinite(point.value):
        facts.append(f"{points.unit.name} **{significant(point.value)}** {points.unit.symbol}")
    if math.isfinite(point.low):
        facts.append(f"95 % interval {interval(point.low, point.high)}")
    if improvement.is_known:
        facts.append(f"against nominal {improvement.text}")
    if math.isfinite(point.ground_truth):
        facts.append(f"{points.truth_name} {significant(point.ground_truth, 4)}")
    facts.append(f"coverage {share(point.coverage)}")
    if point.collapsed > 0:
        facts.append(f"{share(point.collapsed)} of the noisy runs collapsed")
    return ", ".join(facts)


def _changes(data: StudyData, point: TrialPoint) -> str:
    nominal = next((trial.options or {} for trial in data.trials if trial.number == 0), {})
    rows = []
    for option, value in point.options.items():
        shown = inline_code(value_text(value))
        before = inline_code(value_text(nominal[option])) if option in nominal else UNKNOWN
        rows.append((inline_code(option), before, f"**{shown}**" if shown != before else shown))
    return table(["option", ">nominal", ">this trial"], rows)


def _option_table(data: StudyData, chosen: dict[str, bool | int | float | str]) -> str:
    nominal = next((trial.options or {} for trial in data.trials if trial.number == 0), {})
    rows = []
    for option, axis in data.definition.space.items():
        if isinstance(axis, RangeAxis):
            searched = f"{value_text(axis.low)} to {value_text(axis.high)}{', log' if axis.log else ''}"
        else:
            searched = ", ".join(value_text(value) for value in axis.values)
        cells = [inline_code(value_text(where[option])) if option in where else UNKNOWN for where in (nominal, chosen)]
        rows.append((inline_code(option), plain(searched), *cells))
    return table(["option", "searched", ">nominal", ">recommended"], rows)


def _sequence_table(data: StudyData) -> str:
    rows = [
        (
            inline_code(sequence.name),
            str(sequence.num_frames),
            f"{sequence.width} x {sequence.height}",
            "yes, never seen by the search" if sequence.has_ground_truth else "no",
        )
        for sequence in data.sequences
    ]
    return table(["sequence", ">frames", ">size in px", "ground truth"], rows)


def _reading(data: StudyData) -> str:
    gtf, unit = data.definition.gtf, definition_unit(data.definition)
    side = data.definition.side_metric
    infeasible_from = penalty(gtf, len(data.sequences))
    truth = f"- `{side.key}` is the error against **ground truth** ({side.words} [{side.unit}]), which no search reads."
    has_truth = any(sequence.has_ground_truth for sequence in data.sequences)
    return "\n".join(
        [
            f"- The **value** is the {unit.name}: how far trajectories move when Gaussian noise is added to the images "
            f"({count(gtf.clean_runs, 'clean run')} against {gtf.noisy_runs_text} noisy). Smaller is better. It is "
            f"stored as a {_stored_unit(data)}.",
            "- **Intermediate values** are the same number, one noise instance after the other.",
            f"- **Trial 0** has the nominal options ({nominal_text(data.definition)}), and is what every improvement "
            "is measured against.",
            "- `improvement_percent` compares a trial with trial 0 noise instance by noise instance; above 0: better.",
            f"- A trial with a value of {_penalties(infeasible_from, unit)} or more is **infeasible**: a run failed or "
            "registered too few frames; the value is a penalty that keeps samplers away. Switch *Log y scale* on, or "
            "look at the figures instead.",
            *([truth] if has_truth else []),
        ]
    )


def _penalties(stored: float, unit: ScoreUnit) -> str:
    """Return the smallest penalty as it is stored, and as `gtf-tune dashboard` shows it where that differs."""
    return f"{stored:.7g}" if unit.factor == 1 else f"{stored:.7g} ({unit.shown(stored):.7g} {unit.symbol})"


def _stored_unit(data: StudyData) -> str:
    if data.has_several_sequences:
        return "ratio to nominal, the geometric mean over the sequences"
    return (
        "fraction of the trajectory's extent, of which `gtf-tune dashboard` shows per mille"
        if definition_unit(data.definition).factor != 1
        else "number in its own unit"
    )


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
    return Attachment("matrix.csv", "text/csv", table_csv(columns, rows).encode())


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
    return Attachment("trials.csv", "text/csv", table_csv(columns, rows).encode())


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
