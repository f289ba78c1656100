"""Show the score over each option, and whether it tells the truth."""

import math

from gtf_tune.report import markup
from gtf_tune.report.figures import theme
from gtf_tune.report.figures.agreement import agreement_figure, merit_text
from gtf_tune.report.figures.options import option_figure
from gtf_tune.report.panels.blocks import Block, Drawing, ReportInput
from gtf_tune.report.study_data import StudyData
from gtf_tune.report.tables.agreement import agreement
from gtf_tune.report.tables.options import OptionAxis, option_axis, option_curve
from gtf_tune.report.tables.points import PointSet, TrialPoint, sequence_points, study_points

_MOST_FIGURES = 40


def searched_axes(data: StudyData) -> tuple[OptionAxis, ...]:
    """Return the axis of every searched option, in the order of the definition."""
    axes = []
    for name, axis in data.definition.space.items():
        seen = [trial.options[name] for trial in data.trials if trial.options and name in trial.options]
        axes.append(option_axis(name, axis, seen))
    return tuple(axes)


def options_panel(report: ReportInput) -> list[Block]:
    """Return the paper's figure for each option, over all sequences and for each of them."""
    data = report.data
    if not data.feasible:
        return [markup.missing("No trial is feasible and complete yet, so there is no score to show.")]
    scopes = _scopes(data)
    drawings: list[Block] = [
        Drawing(f"option {axis.option} {points.title}", _option_title(data, axis, points), _draw(data, axis, points))
        for axis in searched_axes(data)
        for points in scopes
    ]
    if len(drawings) <= _MOST_FIGURES:
        return drawings
    note = f"Only {_MOST_FIGURES} of {len(drawings)} figures are shown: the study has many options and sequences."
    return [markup.missing(note), *drawings[:_MOST_FIGURES]]


def agreement_panel(report: ReportInput) -> list[Block]:
    """Return the score and the reprojection error against ground truth and against each other, as far as known."""
    blocks: list[Block] = []
    for points in _scopes(report.data):
        blocks.extend(_agreements(points, is_one_of_several=report.data.has_several_sequences))
    if not report.data.validations:
        blocks.insert(0, markup.missing("The study has no ground truth, so the score cannot be compared with it."))
    return blocks


def _scopes(data: StudyData) -> list[PointSet]:
    if not data.has_several_sequences:
        return [study_points(data)]
    return [study_points(data), *(sequence_points(data, one.name) for one in data.sequences)]


def _option_title(data: StudyData, axis: OptionAxis, points: PointSet) -> str:
    return f"{axis.option} ({points.title})" if data.has_several_sequences else axis.option


def _draw(data: StudyData, axis: OptionAxis, points: PointSet) -> object:
    return option_figure(option_curve(points, axis, len(data.definition.space)), points)


def _agreements(points: PointSet, *, is_one_of_several: bool) -> list[Block]:
    pairs = (
        ("GTF vs ground truth", _value, _truth, (points.unit.label, points.truth_label), theme.GTF),
        (
            "Reprojection error vs ground truth",
            _reprojection,
            _truth,
            (_PIXELS, points.truth_label),
            theme.REPROJECTION,
        ),
        ("GTF vs reprojection error", _value, _reprojection, (points.unit.label, _PIXELS), theme.REPROJECTION),
    )
    blocks: list[Block] = []
    for title, x, y, labels, colour in pairs:
        known = [one for one in points.scored if math.isfinite(x(one)) and math.isfinite(y(one))]
        found = agreement(known, x, y)
        if found is not None:
            name = f"{title} ({points.title})"
            shown = f"{title}: {merit_text(found)}" + (f" ({points.title})" if is_one_of_several else "")
            blocks.append(Drawing(name.lower(), shown, agreement_figure(found, labels, colour)))
        elif known or (x is not _truth and y is not _truth):
            blocks.append(markup.missing(f"{title}: {len(known)} trials have both numbers, and it takes three."))
    return blocks


_PIXELS = "mean reprojection error [px]"


def _value(point: TrialPoint) -> float:
    return point.value


def _truth(point: TrialPoint) -> float:
    return point.ground_truth


def _reprojection(point: TrialPoint) -> float:
    return point.reprojection_px
