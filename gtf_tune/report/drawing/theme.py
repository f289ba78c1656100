"""Colours, fonts and the layout that all figures share."""

from typing import Any

import plotly.graph_objects as go

# The colours of the paper's figures.
GTF = "rgb(187,136,187)"
GROUND_TRUTH = "rgb(54,161,101)"
NOMINAL = "rgb(27,107,162)"
REPROJECTION = "rgb(229,126,0)"
GTF_DARK = "rgb(140,80,140)"
GTF_BAND = "rgba(187,136,187,0.25)"
INK = "#1f2933"
FAINT = "#7b8794"
GRID = "#e4e7eb"
WRONG = "#c0392b"
FONT = "Inter, 'Helvetica Neue', Helvetica, Arial, sans-serif"
ERROR_SCALE = "Plasma"
HEIGHT_PX = 400
_TITLE_PX = 34
_AXIS = {
    "gridcolor": GRID,
    "linecolor": "#9aa5b1",
    "showline": True,
    "ticks": "outside",
    "tickcolor": "#9aa5b1",
    "zeroline": False,
    "automargin": True,
}
_LEGEND = {"orientation": "h", "x": 0, "y": 1.02, "yanchor": "bottom", "xanchor": "left", "font": {"size": 12}}
_MARGIN = {"l": 60, "r": 30, "t": 36, "b": 55}


def figure(height: int = HEIGHT_PX, **layout: Any) -> go.Figure:
    """Return an empty figure in the style of the report, without a title; ``height`` is in pixels."""
    return go.Figure(
        layout={
            # An empty template keeps a figure small: the default one alone weighs 7 kB.
            "template": {},
            "height": height,
            "font": {"family": FONT, "size": 13, "color": INK},
            "paper_bgcolor": "white",
            "plot_bgcolor": "white",
            "hoverlabel": {"bgcolor": "white", "font": {"size": 12, "family": FONT}, "align": "left"},
            **layout,
            "margin": {**_MARGIN, **layout.get("margin", {})},
            "legend": {**_LEGEND, **layout.get("legend", {})},
        }
    )


def axis(title: str = "", **settings: Any) -> dict[str, Any]:
    """Return the settings of one axis."""
    return {**_AXIS, "title": {"text": title, "standoff": 8, "font": {"size": 13}}, **settings}


def titled(drawn: go.Figure, title: str) -> go.Figure:
    """Return a copy of a figure with a title above it, for places where nothing else names it."""
    copied = go.Figure(drawn)
    height = drawn.layout.height + _TITLE_PX
    copied.update_layout(
        title={
            "text": title,
            "font": {"size": 15},
            "x": 0.02,
            "xanchor": "left",
            "y": 1 - 0.5 * _TITLE_PX / height,
            "yanchor": "middle",
        },
        margin={"t": (drawn.layout.margin.t or 0) + _TITLE_PX},
        height=height,
    )
    return copied


def restyled(drawn: go.Figure, height: int = HEIGHT_PX) -> go.Figure:
    """Return a figure made by Optuna in the style of the report, without its title."""
    kept = drawn.layout.to_plotly_json()
    layout = {name: kept[name] for name in ("xaxis", "yaxis", "annotations", "shapes") if name in kept}
    plain = figure(height, **layout)
    plain.add_traces(drawn.data)
    return plain
