"""How the search went, in Optuna's own figures."""

import math
import warnings
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from html import escape

import optuna
import plotly.graph_objects as go
from optuna.distributions import BaseDistribution, CategoricalDistribution, FloatDistribution
from optuna.exceptions import ExperimentalWarning
from optuna.importance import PedAnovaImportanceEvaluator
from optuna.trial import FrozenTrial, TrialState, create_trial

from gtf_tune.display import value_text
from gtf_tune.report.drawing import markup, theme
from gtf_tune.report.drawing.axes import OptionAxis, searched_axes, spreads_far, trial_text
from gtf_tune.report.panels.base import Block, Drawing, Panel, ReportInput
from gtf_tune.report.points import PointSet, TrialPoint, study_points

_CONSTRAINT = "coverage"
_ABOVE_THE_WORST = 1.1
_INCOMPLETE = {"pruned": TrialState.PRUNED, "failed": TrialState.FAIL}
_STATES = (
    ("infeasible", theme.WRONG, "x-thin"),
    ("pruned", theme.REPROJECTION, "triangle-down"),
    ("failed", theme.INK, "cross-thin"),
)
_FEWEST_FOR_IMPORTANCE = 8
_BEST_TO_WORST: theme.Scale = ((0.0, "rgb(160,70,160)"), (1.0, "rgb(170,180,190)"))


def optuna_copy(points: PointSet, axes: Sequence[OptionAxis]) -> optuna.Study:
    """Return a study with the same trial numbers, options and states.

    Infeasible trials have a penalty for a value, which would hide all others in a figure: here they lie a tenth above
    the worst feasible value, and are marked as infeasible.
    """
    with _without_messages():
        study = optuna.create_study(direction="minimize", sampler=optuna.samplers.RandomSampler(seed=0))
    ceiling = infeasible_level(points)
    by_name = {axis.option: axis for axis in axes}
    study.add_trials([_copied(point, by_name, ceiling) for point in points.points])
    return study


def infeasible_level(points: PointSet) -> float:
    """Return where infeasible trials are drawn: a tenth above the worst feasible value."""
    return _ABOVE_THE_WORST * max((point.value for point in points.scored), default=1.0)


def history_figure(study: optuna.Study, points: PointSet) -> go.Figure:
    """Return Optuna's optimisation history, with infeasible, pruned and failed trials marked as such."""
    drawn = theme.restyled(optuna.visualization.plot_optimization_history(study))
    for trace, (name, style) in zip(drawn.data, _history_styles(points), strict=False):
        trace.update(name=name, **style)
    drawn.data = drawn.data[:2]
    by_number = {point.number: point for point in points.points}
    drawn.data[0].update(
        hovertext=[trial_text(by_number[number], points) for number in drawn.data[0].x], hoverinfo="text"
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
        440,
    )
    for trace in drawn.data:
        if trace.mode == "lines" and trace.y is not None and trace.y[0] is not None:
            trace.line.color = theme.sampled(_BEST_TO_WORST, [float(trace.y[0])])[0]
        elif trace.marker.colorbar.title.text:
            trace.marker.update(
                colorscale=_BEST_TO_WORST, reversescale=False, colorbar=theme.colour_bar(points.unit.label)
            )
    labels = [points.unit.name, *(_folded(option) for option in sorted(options))]
    drawn.update_layout(
        xaxis={**theme.axis(), "ticktext": labels, "showgrid": False, "showline": False, "ticks": ""},
        margin={"l": 70, "t": 40, "b": 110},
    )
    return drawn


def importance_figure(study: optuna.Study) -> go.Figure:
    """Return Optuna's importances by PED-ANOVA: which options decide whether a configuration is among the best.

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
    styled = theme.restyled(drawn, 114 + 34 * names)
    styled.update_traces(marker_color=theme.GTF, hoverinfo="x+y", hovertemplate=None)
    styled.update_layout(
        showlegend=False,
        xaxis=theme.axis("share of the importance"),
        yaxis=theme.axis("", showgrid=False),
        margin={"r": 60, "t": 34},
    )
    return styled


def search_panel(report: ReportInput) -> list[Block]:
    """Return Optuna's history, parallel coordinates and importances."""
    points, axes = study_points(report.data), searched_axes(report.data)
    if not points.scored:
        return [markup.missing("No trial is feasible and complete yet, so there is no search to show.")]
    study = optuna_copy(points, axes)
    blocks: list[Block] = [Drawing("history", "Optimisation history", history_figure(study, points), is_wide=True)]
    if len(axes) == 1:
        return [*blocks, markup.missing("The study searches one option, so there is nothing to rank.")]
    names = [axis.option for axis in axes]
    drawn = parallel_figure(study, points, names)
    blocks.append(Drawing("parallel coordinates", "Parallel coordinates", drawn, is_wide=True))
    if any(point.state == "infeasible" for point in points.points):
        blocks.append(
            markup.paragraph("Infeasible trials have no value; they are drawn above the worst feasible one.", "note")
        )
    return [*blocks, _importance(study, points)]


def _copied(point: TrialPoint, axes: Mapping[str, OptionAxis], ceiling: float) -> FrozenTrial:
    params = {name: _copied_value(axes[name], value) for name, value in point.options.items() if name in axes}
    complete = point.is_scored or point.state == "infeasible"
    return create_trial(
        state=TrialState.COMPLETE if complete else _INCOMPLETE.get(point.state, TrialState.RUNNING),
        value=(point.value if point.is_scored else ceiling) if complete else None,
        params=params,
        distributions={name: _distribution(axes[name]) for name in params},
        constraints={_CONSTRAINT: 0.0 if point.is_scored else 1.0} if complete else None,
    )


def _copied_value(axis: OptionAxis, value: bool | int | float | str) -> float | str:
    return value_text(value) if axis.scale == "categories" else float(value)


def _distribution(axis: OptionAxis) -> BaseDistribution:
    if axis.scale == "categories":
        return CategoricalDistribution(axis.categories)
    return FloatDistribution(axis.low, axis.high, log=axis.scale == "log")


@contextmanager
def _without_messages() -> Iterator[None]:
    before = optuna.logging.get_verbosity()
    optuna.logging.set_verbosity(optuna.logging.WARNING)
    try:
        yield
    finally:
        optuna.logging.set_verbosity(before)


def _history_styles(points: PointSet) -> list[tuple[str, dict[str, object]]]:
    marker = {"color": theme.GTF, "size": 7, "line": {"color": theme.PAPER, "width": 1}}
    line = {"color": theme.GTF_DARK, "width": 2, "shape": "hv"}
    return [(points.unit.name, {"marker": marker}), ("lowest so far", {"line": line, "mode": "lines"})]


def _add_state(drawn: go.Figure, points: PointSet, state: str, style: tuple[str, str]) -> None:
    chosen = [point for point in points.points if point.state == state]
    if chosen:
        colour, symbol = style
        drawn.add_scatter(
            x=[point.number for point in chosen],
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


def _importance(study: optuna.Study, points: PointSet) -> Block:
    complete = [point for point in points.points if point.is_scored or point.state == "infeasible"]
    if len(complete) < _FEWEST_FOR_IMPORTANCE:
        return markup.missing(
            f"Importances need at least {_FEWEST_FOR_IMPORTANCE} complete trials; the study has {len(complete)}."
        )
    return Drawing("importance", "Importance of the options (PED-ANOVA)", importance_figure(study), is_wide=True)


PANEL = Panel("Search", search_panel)
