"""Draw the search with Optuna's own figures, and coverage beside it."""

import math
import warnings
from collections.abc import Sequence
from html import escape

import optuna
import plotly.graph_objects as go
from optuna.exceptions import ExperimentalWarning
from optuna.importance import PedAnovaImportanceEvaluator

from gtf_tune.report.figures import theme
from gtf_tune.report.figures.hover import trial_text
from gtf_tune.report.figures.option_axes import spreads_far
from gtf_tune.report.tables.optuna_copy import infeasible_level
from gtf_tune.report.tables.points import PointSet

_STATES = (
    ("infeasible", theme.WRONG, "x-thin"),
    ("pruned", theme.REPROJECTION, "triangle-down"),
    ("failed", theme.INK, "cross-thin"),
)


def history_figure(study: optuna.Study, points: PointSet) -> go.Figure:
    """Return Optuna's optimisation history, with infeasible, pruned and failed trials marked as such."""
    drawn = theme.restyled(optuna.visualization.plot_optimization_history(study))
    for trace, (name, style) in zip(drawn.data, _history_styles(points), strict=False):
        trace.update(name=name, **style)
    drawn.data = drawn.data[:2]
    by_ordinal = {point.ordinal: point for point in points.points}
    drawn.data[0].update(
        hovertext=[trial_text(by_ordinal[ordinal], points) for ordinal in drawn.data[0].x], hoverinfo="text"
    )
    for state, colour, symbol in _STATES:
        _add_state(drawn, points, state, (colour, symbol))
    far = spreads_far([point.value for point in points.scored])
    drawn.update_layout(
        xaxis=theme.axis("trial"),
        yaxis=theme.axis(points.unit.label, **({"type": "log", "dtick": 1} if far else {})),
    )
    return drawn


def parallel_figure(study: optuna.Study, points: PointSet, options: Sequence[str]) -> go.Figure:
    """Return Optuna's parallel coordinates with whole option names; infeasible trials are dotted."""
    drawn = theme.restyled(
        optuna.visualization.plot_parallel_coordinate(study, target_name=points.unit.label),
        430,
    )
    labels = [points.unit.name, *(_folded(option) for option in sorted(options))]
    drawn.update_layout(
        xaxis={**theme.axis(), "ticktext": labels, "showgrid": False, "showline": False, "ticks": ""},
        margin={"l": 70, "t": 50, "b": 75},
    )
    return drawn


def importance_figure(study: optuna.Study) -> go.Figure:
    """Return Optuna's importances by PED-ANOVA: which options decide whether a setting is among the best.

    Raises
    ------
    ValueError
        There are too few trials, or they do not differ.
    """
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", ExperimentalWarning)
        evaluator = PedAnovaImportanceEvaluator()
        drawn = optuna.visualization.plot_param_importances(study, evaluator=evaluator)
    names = len(study.best_trial.params)
    styled = theme.restyled(drawn, 90 + 34 * names)
    styled.update_traces(marker_color=theme.GTF, hoverinfo="x+y", hovertemplate=None)
    styled.update_layout(
        showlegend=False,
        xaxis=theme.axis("share of the importance"),
        yaxis=theme.axis("", showgrid=False),
        margin={"r": 60, "t": 10},
    )
    return styled


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
                x=[point.ordinal for point in chosen],
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


def _history_styles(points: PointSet) -> list[tuple[str, dict[str, object]]]:
    marker = {"color": theme.GTF, "size": 7, "line": {"color": "white", "width": 1}}
    line = {"color": theme.GTF_DARK, "width": 2, "shape": "hv"}
    return [(points.unit.name, {"marker": marker}), ("best so far", {"line": line, "mode": "lines"})]


def _add_state(drawn: go.Figure, points: PointSet, state: str, style: tuple[str, str]) -> None:
    chosen = [point for point in points.points if point.state == state]
    if chosen:
        colour, symbol = style
        drawn.add_scatter(
            x=[point.ordinal for point in chosen],
            y=[point.value if math.isfinite(point.value) else infeasible_level(points) for point in chosen],
            mode="markers",
            name=state,
            marker={"color": colour, "symbol": symbol, "size": 9, "line": {"color": colour, "width": 2}},
            hovertext=[trial_text(point, points) for point in chosen],
            hoverinfo="text",
        )


def _folded(option: str, width: int = 22) -> str:
    """Return an option name in lines of about so many characters, broken at its dots."""
    lines = [""]
    for part in option.split("."):
        piece = part if lines == [""] else f".{part}"
        if lines[-1] and len(lines[-1]) + len(piece) > width:
            lines.append("")
        lines[-1] += piece
    return "<br>".join(escape(line) for line in lines)
