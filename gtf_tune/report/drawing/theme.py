"""Colours, fonts and the layout that all figures share."""

from collections.abc import Mapping, Sequence
from types import MappingProxyType
from typing import Any

import plotly.graph_objects as go
from plotly.colors import sample_colorscale

Scale = tuple[tuple[float, str], ...]
"""Colours at shares from 0 to 1."""

# The colours of the paper's figures.
GTF = "rgb(187,136,187)"
GROUND_TRUTH = "rgb(54,161,101)"
NOMINAL = "rgb(27,107,162)"
REPROJECTION = "rgb(229,126,0)"
GTF_DARK = "rgb(140,80,140)"
GTF_BAND = "rgba(187,136,187,0.25)"
INK = "#1f2933"
FAINT = "#66727f"
GRID = "#e4e7eb"
LINE = "#9aa5b1"
WRONG = "#c0392b"
PAPER = "white"

DARK: Mapping[str, str] = MappingProxyType(
    {
        GTF_DARK: "rgb(217,169,217)",
        NOMINAL: "rgb(94,170,222)",
        GROUND_TRUTH: "rgb(79,191,128)",
        INK: "#e6ebf0",
        FAINT: "#9aa7b4",
        GRID: "#333d48",
        LINE: "#66727f",
        WRONG: "#f07565",
        PAPER: "#1b222a",
    }
)
"""What the colours of figures become where the reader prefers dark pages."""
FONT = "Inter, 'Helvetica Neue', Helvetica, Arial, sans-serif"
ERROR_SCALE: Scale = ((0.0, "rgb(58,112,176)"), (0.5, "rgb(226,178,70)"), (1.0, "rgb(192,57,43)"))
"""From small errors to large ones; every colour is visible on white and on dark paper."""
HEIGHT_PX = 400
_TITLE_PX = 34
_TOOLBAR_PX = 40
_AXIS = {
    "gridcolor": GRID,
    "linecolor": LINE,
    "showline": True,
    "ticks": "outside",
    "tickcolor": LINE,
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
            "paper_bgcolor": PAPER,
            "plot_bgcolor": PAPER,
            "hoverlabel": {
                "bgcolor": PAPER,
                "bordercolor": LINE,
                "font": {"size": 12, "family": FONT},
                "align": "left",
            },
            **layout,
            "margin": {**_MARGIN, **layout.get("margin", {})},
            "legend": {**_LEGEND, **layout.get("legend", {})},
        }
    )


def axis(title: str = "", **settings: Any) -> dict[str, Any]:
    """Return the settings of one axis."""
    return {**_AXIS, "title": {"text": title, "standoff": 8, "font": {"size": 13}}, **settings}


def colour_bar(title: str, **settings: Any) -> dict[str, Any]:
    """Return a colour bar below a figure, where it meets neither the toolbar nor the data."""
    return {
        "title": {"text": title, "side": "right", "font": {"size": 12}},
        "orientation": "h",
        "x": 0,
        "xanchor": "left",
        "yref": "container",
        "y": 0,
        "yanchor": "bottom",
        "len": 300,
        "lenmode": "pixels",
        "thickness": 12,
        "outlinewidth": 0,
        **settings,
    }


def sampled(scale: Scale, shares: Sequence[float]) -> list[str]:
    """Return the colours of a scale at shares from 0 to 1; those outside take the colour of the end."""
    inside = [min(max(share, 0.0), 1.0) for share in shares]
    colours: list[str] = sample_colorscale([list(stop) for stop in scale], inside)
    return colours


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
        margin={"t": (drawn.layout.margin.t or 0) + _TITLE_PX, "r": max(drawn.layout.margin.r or 0, _TOOLBAR_PX)},
        modebar={"orientation": "v"},  # beside the figure, where it covers no title
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
