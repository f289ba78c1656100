"""Every trial with its numbers."""

import math

from gtf_tune.display import duration, interval, percent, share, significant, value_text
from gtf_tune.report.drawing import markup
from gtf_tune.report.drawing.markup import Html
from gtf_tune.report.panels.base import Block, Panel, ReportInput
from gtf_tune.report.points import PointSet, TrialPoint, study_points


def trials_panel(report: ReportInput) -> list[Block]:
    """Return the trials as a table, the best first, those beyond the first rows folded away."""
    points = study_points(report.data)
    if not points.points:
        return [markup.missing("No trial has begun yet.")]
    ordered = sorted(points.points, key=_rank)
    shown = report.lengths.trial_rows
    blocks: list[Block] = [_trial_table(points, ordered[:shown], list(report.data.definition.space))]
    if len(ordered) > shown:
        rest = _trial_table(points, ordered[shown:], list(report.data.definition.space))
        blocks.append(markup.folded(f"{len(ordered) - shown} more trials", rest))
    return blocks


def _rank(point: TrialPoint) -> tuple[int, float, int]:
    order = ("feasible", "infeasible", "pruned", "failed", "running")
    value = point.value if math.isfinite(point.value) else math.inf
    return order.index(point.state), value, point.number


def _trial_table(points: PointSet, rows: list[TrialPoint], options: list[str]) -> Html:
    has_truth = points.has_ground_truth
    columns = [">trial", "state", f">{points.unit.label}", ">95 % interval", ">improvement"]
    columns += [*([f">{points.truth_label}"] if has_truth else []), ">coverage", ">collapsed", ">time"]
    columns += [f">{option.rpartition('.')[2]}" for option in options]
    return markup.table(columns, [_trial_row(point, points, options, has_truth=has_truth) for point in rows])


def _trial_row(point: TrialPoint, points: PointSet, options: list[str], *, has_truth: bool) -> list[object]:
    nominal = points.nominal
    improvement = 1 - point.value / nominal.value if nominal and nominal.value else math.nan
    return [
        f"{point.number}{' (nominal)' if point.number == 0 else ''}",
        _state_cell(point),
        significant(point.value),
        interval(point.low, point.high),
        percent(improvement) if point.number else "-",
        *([significant(point.ground_truth)] if has_truth else []),
        share(point.coverage),
        share(point.collapsed),
        duration(point.wall_s),
        *(value_text(point.options[name]) if name in point.options else "-" for name in options),
    ]


def _state_cell(point: TrialPoint) -> markup.Marked:
    return markup.cell(
        markup.element("span", markup.text(point.state), class_=f"state {point.state}", title=point.message)
    )


PANEL = Panel("Trials", trials_panel)
