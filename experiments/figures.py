"""Draw what the experiments found, as SVG files for the documentation."""

from collections.abc import Callable, Mapping
from pathlib import Path
from types import MappingProxyType

import plotly.graph_objects as go

from benchmarks.drawing import write_svgs
from experiments.findings import Findings
from experiments.plan import AGGREGATE
from experiments.settings import PREDICTORS
from experiments.tables import COUNTS
from gtf_tune.report.drawing import theme

FOLDER = "images/results"
_ROW_PX = 22
_WITH_LEGEND_PX = 560
_COLOURS = (theme.GTF_DARK, theme.GROUND_TRUTH, theme.NOMINAL, theme.REPROJECTION, theme.FAINT)
_DASHES = MappingProxyType({"mean": "dot", "median": "solid", "gmean": "dash", "trimmed": "dashdot"})


def write_figures(findings: Findings, folder: Path) -> list[str]:
    """Write the figures that have data into ``folder`` and return their names."""
    return write_svgs({name: draw(findings) for name, draw in _FIGURES.items()}, folder)


def gains(findings: Findings) -> go.Figure:
    """Draw the changes of the true ATE at pick, adopted setting and oracle, one row for each grid of table 2."""
    ranked = sorted(findings.outcomes, key=lambda one: -one.change(one.oracle))
    names = [f"{one.experiment.sequence} {one.experiment.option.short}" for one in ranked]
    figure = theme.figure(120 + _ROW_PX * len(ranked), margin={"l": 150})
    picks = [one.agreement(PREDICTORS[AGGREGATE]).pick for one in ranked]
    confirmed = [(name, one) for name, one in zip(names, ranked, strict=True) if one.adopted is not None]
    points = {
        "best by ground truth": (names, [one.change(one.oracle) for one in ranked], theme.GROUND_TRUTH, "circle"),
        "picked by GTF ATE": (
            names,
            [one.change(pick) for one, pick in zip(ranked, picks, strict=True)],
            theme.GTF_DARK,
            "diamond-open",
        ),
        "after confirmation": (
            [name for name, _ in confirmed],
            [one.change(one.adopted) for _, one in confirmed if one.adopted is not None],
            theme.NOMINAL,
            "x-thin",
        ),
    }
    for label, (rows, changes, colour, symbol) in points.items():
        marker = {"color": colour, "symbol": symbol, "size": 10, "line": {"width": 2, "color": colour}}
        if rows:
            figure.add_trace(
                go.Scatter(x=[100 * change for change in changes], y=rows, mode="markers", name=label, marker=marker)
            )
    figure.update_xaxes(**theme.axis("change of the true ATE against nominal [%], negative is better"))
    figure.update_yaxes(**theme.axis())
    figure.add_vline(x=0, line={"color": theme.NOMINAL, "width": 1, "dash": "dash"})
    return figure


def k_delta(findings: Findings) -> go.Figure:
    """Draw R2 between score and true ATE over the number of noisy runs, one line for each aggregate."""
    figure = theme.figure(_WITH_LEGEND_PX)
    for number, curve in enumerate(findings.curves):
        for name, values in curve.r_squared.items():
            line = {"color": _COLOURS[number % len(_COLOURS)], "dash": _DASHES[name]}
            figure.add_trace(go.Scatter(x=curve.counts, y=values, name=f"{curve.study}, {name}", line=line))
    figure.update_xaxes(**theme.axis("noisy runs (k_delta)", type="log", tickvals=list(COUNTS)))
    figure.update_yaxes(**theme.axis("R2 with the true ATE", range=[0, 1.02]))
    return figure


def noise(findings: Findings) -> go.Figure:
    """Draw the score of the nominal setting over sigma, one line for each sequence; recommended levels are filled."""
    figure = theme.figure()
    for ladder, colour in zip(findings.ladders, _COLOURS, strict=False):
        symbols = ["circle" if rung.sigma == ladder.recommended else "circle-open" for rung in ladder.rungs]
        figure.add_trace(
            go.Scatter(
                x=[rung.sigma for rung in ladder.rungs],
                y=[1000 * rung.score for rung in ladder.rungs],
                name=ladder.sequence,
                mode="lines+markers",
                line={"color": colour},
                marker={"symbol": symbols, "size": 9},
            )
        )
        figure.add_hline(y=1000 * ladder.floor, line={"color": colour, "width": 1, "dash": "dot"})
    levels = sorted({rung.sigma for ladder in findings.ladders for rung in ladder.rungs})
    figure.update_xaxes(**theme.axis("sigma [grey levels]", type="log", tickvals=levels))
    figure.update_yaxes(**theme.axis("GTF ATE [‰ of the extent]; dotted: clean runs", type="log", dtick=1))
    return figure


def options(findings: Findings) -> go.Figure:
    """Draw the range of the true ATE over the values of each option of the ablation, the widest last."""
    ranges = []
    for one in findings.ablated:
        changes = [100 * one.change(setting) for setting in one.feasible]
        name = f"{one.experiment.sequence} {one.experiment.option.name}"
        ranges.append((max(changes) - min(changes), name, min(changes), max(changes)))
    ranges.sort()
    figure = theme.figure(120 + _ROW_PX * len(ranges), margin={"l": 400})
    if ranges:
        figure.add_trace(
            go.Bar(
                y=[name for _, name, _, _ in ranges],
                x=[high - low for _, _, low, high in ranges],
                base=[low for _, _, low, _ in ranges],
                orientation="h",
                marker={"color": theme.GROUND_TRUTH},
            )
        )
    figure.update_xaxes(**theme.axis("true ATE against nominal [%], cut at +100 %", range=[-60, 100]))
    figure.update_yaxes(**theme.axis())
    return figure


_FIGURES: Mapping[str, Callable[[Findings], go.Figure]] = MappingProxyType(
    {"gains": gains, "k-delta": k_delta, "noise": noise, "options": options}
)
