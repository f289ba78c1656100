"""Show how the search went: history, importances, every trial, coverage."""

import math

import optuna

from gtf_tune.display import duration, interval, percent, share, significant, value_text
from gtf_tune.report import markup
from gtf_tune.report.figures.search import coverage_figure, history_figure, importance_figure, parallel_figure
from gtf_tune.report.markup import Html
from gtf_tune.report.panels.blocks import Block, Drawing, ReportInput
from gtf_tune.report.panels.scores import searched_axes
from gtf_tune.report.study_data import StudyData
from gtf_tune.report.tables.details import nominal_floor
from gtf_tune.report.tables.optuna_copy import optuna_copy
from gtf_tune.report.tables.points import PointSet, TrialPoint, study_points

_FEWEST_FOR_IMPORTANCE = 8


def search_panel(report: ReportInput) -> list[Block]:
    """Return Optuna's history, parallel coordinates and importances."""
    points, axes = study_points(report.data), searched_axes(report.data)
    if not points.scored:
        return [markup.missing("No trial is feasible and complete yet, so there is no search to show.")]
    study = optuna_copy(points, axes)
    blocks: list[Block] = [Drawing("history", "Optimisation history", history_figure(study, points), is_wide=True)]
    if len(axes) == 1:
        return [*blocks, markup.missing("The study searches one option, so there is nothing to rank or to combine.")]
    names = [axis.option for axis in axes]
    drawn = parallel_figure(study, points, names)
    blocks.append(Drawing("parallel coordinates", "Parallel coordinates", drawn, is_wide=True))
    if any(point.state == "infeasible" for point in points.points):
        blocks.append(
            markup.paragraph("Infeasible trials have no value; they are drawn above the worst feasible one.", "note")
        )
    return [*blocks, _importance(study, points)]


def trials_panel(report: ReportInput) -> list[Block]:
    """Return the trials as a table, the best first, those beyond the first rows folded away."""
    points = study_points(report.data)
    if not points.points:
        return [markup.missing("No trial has begun yet.")]
    ordered = sorted(points.points, key=_rank)
    shown = report.definition.trial_rows
    blocks: list[Block] = [_trial_table(points, ordered[:shown], list(report.data.definition.space))]
    if len(ordered) > shown:
        rest = _trial_table(points, ordered[shown:], list(report.data.definition.space))
        blocks.append(markup.folded(f"{len(ordered) - shown} more trials", rest))
    return blocks


def coverage_panel(report: ReportInput) -> list[Block]:
    """Return the coverage of each trial, with the floors of each sequence."""
    data, points = report.data, study_points(report.data)
    if not any(math.isfinite(point.coverage) for point in points.points):
        return [markup.missing("No trial is complete yet, so there is no coverage to show.")]
    drawn = coverage_figure(points, [floor for one in data.sequences for floor in _floors(data, one.name)])
    return [Drawing("coverage", "", drawn, is_wide=True)]


def _floors(data: StudyData, sequence: str) -> list[tuple[str, float]]:
    """Return the names and the values of the floors of a sequence: one, or two where noise costs nominal frames."""
    found = nominal_floor(data, sequence)
    if found is None:
        return []
    name = sequence if data.has_several_sequences else ""
    if found.clean == found.noisy:
        return [(name, found.clean)]
    return [(f"{name} clean runs".strip(), found.clean), (f"{name} noisy runs".strip(), found.noisy)]


def _importance(study: optuna.Study, points: PointSet) -> Block:
    complete = [point for point in points.points if point.is_scored or point.state == "infeasible"]
    if len(complete) < _FEWEST_FOR_IMPORTANCE:
        return markup.missing(
            f"Importances need at least {_FEWEST_FOR_IMPORTANCE} complete trials; the study has {len(complete)}."
        )
    return Drawing("importance", "Importance of the options (PED-ANOVA)", importance_figure(study), is_wide=True)


def _rank(point: TrialPoint) -> tuple[int, float, int]:
    order = ("feasible", "infeasible", "pruned", "failed", "running")
    value = point.value if math.isfinite(point.value) else math.inf
    return order.index(point.state), value, point.ordinal


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
        f"{point.ordinal}{' (nominal)' if point.ordinal == 0 else ''}",
        _state_cell(point),
        significant(point.value),
        interval(point.low, point.high),
        percent(improvement) if point.ordinal else "-",
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
