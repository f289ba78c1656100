"""Every trial with its numbers."""

import math

from gtf_tune.display import duration, interval, share, significant, value_text
from gtf_tune.report.drawing import markup
from gtf_tune.report.drawing.markup import Html
from gtf_tune.report.panels.base import Block, Panel, ReportInput
from gtf_tune.report.points import PointSet, TrialPoint, study_points
from gtf_tune.report.study_data import StudyData


def trials_panel(report: ReportInput) -> list[Block]:
    """Return the trials as a table, the best first, those beyond the first rows folded away."""
    points = study_points(report.data)
    if not points.points:
        return [markup.missing("No trial has begun yet.")]
    ordered = sorted(points.points, key=_rank)
    shown = report.lengths.trial_rows
    blocks: list[Block] = [_trial_table(points, ordered[:shown], report.data)]
    if len(ordered) > shown:
        rest = _trial_table(points, ordered[shown:], report.data)
        blocks.append(markup.folded(f"{len(ordered) - shown} more trials", rest))
    return blocks


def _rank(point: TrialPoint) -> tuple[int, float, int]:
    order = ("feasible", "infeasible", "pruned", "failed", "running", "interrupted", "waiting")
    value = point.value if math.isfinite(point.value) else math.inf
    return order.index(point.state), value, point.number


def _trial_table(points: PointSet, rows: list[TrialPoint], data: StudyData) -> Html:
    columns = [">trial", "state", *(f">{option.rpartition('.')[2]}" for option in data.definition.space)]
    columns += [f">{points.unit.label}", ">95 % interval", ">change in the search", ">95 % interval"]
    columns += [*([f">{points.truth_label}"] if points.has_ground_truth else [])]
    columns += [">registered frames", ">diverged", ">time"]
    return markup.table(columns, [_trial_row(point, points, data) for point in rows], "Trials")


def _trial_row(point: TrialPoint, points: PointSet, data: StudyData) -> list[object]:
    improvement = data.improvement(point.number)
    return [
        _trial_name(point.number, data),
        _state_cell(point),
        *(value_text(point.options[name]) if name in point.options else "-" for name in data.definition.space),
        significant(point.value),
        interval(point.low, point.high),
        improvement.change,
        improvement.bounds,
        *([significant(point.ground_truth)] if points.has_ground_truth else []),
        share(point.coverage),
        share(point.collapsed),
        duration(point.wall_s),
    ]


def _trial_name(number: int, data: StudyData) -> str:
    recommended = data.recommendation.trial
    notes = ["nominal"] if number == 0 else []
    if recommended is not None and recommended.number == number:
        notes.append("recommended" if data.recommendation.is_confirmed else "best so far")
    return f"{number} ({', '.join(notes)})" if notes else str(number)


def _state_cell(point: TrialPoint) -> markup.Marked:
    return markup.cell(
        markup.element("span", markup.text(point.state), class_=f"state {point.state}", title=point.message)
    )


PANEL = Panel("Trials", trials_panel)
