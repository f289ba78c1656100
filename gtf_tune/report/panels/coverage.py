"""The share of registered frames of every trial."""

import math
from collections.abc import Sequence

import plotly.graph_objects as go

from gtf_tune.report.drawing import markup, theme
from gtf_tune.report.drawing.axes import trial_text
from gtf_tune.report.drawing.markup import Html
from gtf_tune.report.panels.base import Block, Drawing, Panel, ReportInput
from gtf_tune.report.points import PointSet, nominal_floor, study_points
from gtf_tune.report.study_data import StudyData


def coverage_figure(points: PointSet, floors: Sequence[tuple[str, float]]) -> go.Figure:
    """Return the coverage of each trial, with the floors below which a trial is infeasible."""
    drawn = theme.figure(height=320)
    styles = {
        "feasible": (theme.GTF, "circle"),
        "infeasible": (theme.WRONG, "x"),
        "pruned": (theme.REPROJECTION, "triangle-down"),
    }
    for state, (colour, symbol) in styles.items():
        chosen = [point for point in points.points if point.state == state and math.isfinite(point.coverage)]
        if chosen:
            drawn.add_scatter(
                x=[point.number for point in chosen],
                y=[100 * point.coverage for point in chosen],
                mode="markers",
                name=state,
                marker={"color": colour, "symbol": symbol, "size": 8},
                hovertext=[trial_text(point, points) for point in chosen],
                hoverinfo="text",
            )
    for name, floor in floors:
        note = {
            "text": f"floor {name} {100 * floor:.0f} %".replace("  ", " "),
            "font": {"size": 11, "color": theme.FAINT},
        }
        drawn.add_hline(
            y=100 * floor,
            line={"color": theme.FAINT, "dash": "dash", "width": 1},
            annotation={**note, "showarrow": False},
            annotation_position="bottom right",
        )
    drawn.update_layout(
        xaxis=theme.axis("trial"),
        yaxis=theme.axis("coverage of the worst run [%]", range=[-3, 104]),
        showlegend=True,
    )
    return drawn


def coverage_panel(report: ReportInput) -> list[Block]:
    """Return the coverage of each trial, with the floors of each sequence."""
    data, points = report.data, study_points(report.data)
    if not any(math.isfinite(point.coverage) for point in points.points):
        return [markup.missing("No trial is complete yet, so there is no coverage to show.")]
    drawn = coverage_figure(points, [floor for sequence in data.sequences for floor in _floors(data, sequence.name)])
    return [Drawing("coverage", "", drawn, is_wide=True), *_counted_frames(data)]


def _counted_frames(data: StudyData) -> list[Html]:
    """Return a sentence for each sequence on the frames by which configurations are scored, where not all count."""
    stored = data.details.get(0, {}).get("sequences", {})
    counted = [(sequence, stored.get(sequence.name, {}).get("counted_frames")) for sequence in data.sequences]
    return [
        markup.paragraph(
            f"On {sequence.name}, errors are taken at the {number} of {sequence.num_frames} frames that every "
            "dependable run of nominal registered."
        )
        for sequence, number in counted
        if number is not None and number < sequence.num_frames
    ]


def _floors(data: StudyData, sequence: str) -> list[tuple[str, float]]:
    """Return the names and the values of the floors of a sequence: one, or two where noise costs nominal frames."""
    found = nominal_floor(data, sequence)
    if found is None:
        return []
    name = sequence if data.has_several_sequences else ""
    if found.clean == found.noisy:
        return [(name, found.clean)]
    return [(f"{name} clean runs".strip(), found.clean), (f"{name} noisy runs".strip(), found.noisy)]


PANEL = Panel(
    "Coverage",
    coverage_panel,
    ("Registered frames over all frames, in the worst run of each trial."),
)
