"""Draw the runs of one setting laid on each other, coloured by how far each frame moves."""

from collections.abc import Sequence
from typing import Any

import numpy as np
import plotly.graph_objects as go

from gtf_tune.display import significant
from gtf_tune.report.figures import theme
from gtf_tune.report.tables.trajectories import AlignedRun, FrameSpread, known_errors

_HIGHEST_PERCENTILE = 98
_MARKER_PX = 4
_WIDTH_PX, _SURROUNDINGS_PX, _LOWEST_PX, _HIGHEST_PX = 430, 90, 200, 460
_SIDE = {"title": {"text": ""}, "gridcolor": theme.GRID, "showbackground": False, "zeroline": False, "nticks": 5}
_LABELLED_SHARE = 0.25
_EYE = {"x": 0.6, "y": -0.85, "z": 0.6}
_CLEAN = {"color": "rgb(110,120,130)", "width": 2}


def error_range(settings: Sequence[Sequence[AlignedRun]]) -> tuple[float, float]:
    """Return the range of colours for several settings: 0 to what all but 2 % of the errors stay below."""
    errors = np.concatenate([known_errors(runs) for runs in settings]) if settings else np.empty(0)
    return 0.0, float(np.percentile(errors, _HIGHEST_PERCENTILE)) if errors.size else 1.0


def scene_figure(runs: Sequence[AlignedRun], colours: tuple[float, float]) -> go.Figure:
    """Return the runs in 3-D, in units of the extent."""
    drawn = theme.figure(height=430)
    for run in (one for one in runs if one.kind == "clean"):
        x, y, z = run.positions.T
        drawn.add_scatter3d(x=x, y=y, z=z, mode="lines", line=_CLEAN, **_clean_words(run))
    noisy = [one for one in runs if one.kind == "noisy"]
    for number, run in enumerate(noisy):
        x, y, z = run.positions.T
        marker = {"size": 2.5, **_colours(run, colours, is_last=number == len(noisy) - 1)}
        drawn.add_scatter3d(x=x, y=y, z=z, mode="markers", marker=marker, **_noisy_words(run))
    proportions = _proportions(runs)
    sides = {f"{name}axis": {**_SIDE, "showticklabels": share > _LABELLED_SHARE} for name, share in proportions.items()}
    drawn.update_layout(
        showlegend=False,
        margin={"l": 0, "r": 0, "t": 5, "b": 5},
        scene={**sides, "aspectmode": "manual", "aspectratio": proportions, "camera": {"eye": _EYE}},
    )
    return drawn


def top_figure(runs: Sequence[AlignedRun], colours: tuple[float, float]) -> go.Figure:
    """Return the runs seen along the direction in which the camera moved least, in units of the extent."""
    proportions = _proportions(runs)
    drawn = theme.figure(height=_height(proportions["y"] / proportions["x"]))
    for run in (one for one in runs if one.kind == "clean"):
        drawn.add_scatter(x=run.positions[:, 0], y=run.positions[:, 1], mode="lines", line=_CLEAN, **_clean_words(run))
    noisy = [one for one in runs if one.kind == "noisy"]
    for number, run in enumerate(noisy):
        marker = {"size": _MARKER_PX, **_colours(run, colours, is_last=number == len(noisy) - 1)}
        drawn.add_scatter(
            x=run.positions[:, 0], y=run.positions[:, 1], mode="markers", marker=marker, **_noisy_words(run)
        )
    drawn.update_layout(
        showlegend=False,
        margin={"t": 15},
        xaxis=theme.axis("extents", constrain="domain"),
        yaxis=theme.axis("extents", scaleanchor="x", constrain="domain"),
    )
    return drawn


def spread_figure(spreads: Sequence[tuple[FrameSpread, str]]) -> go.Figure:
    """Return how far frames move, for several settings each with its colour, over how often they are registered."""
    drawn = theme.figure(height=420)
    for spread, colour in spreads:
        hover = [_frame_text(spread, index) for index in range(len(spread.frame_ids))]
        words = {"hovertext": hover, "hoverinfo": "text"}
        drawn.add_scatter(
            x=spread.frame_ids, y=spread.median, mode="lines", name=spread.title, line={"color": colour}, **words
        )
        drawn.add_scatter(
            x=spread.frame_ids[spread.fragile],
            y=spread.median[spread.fragile],
            mode="markers",
            name=f"fragile ({spread.title})",
            marker={"color": colour, "size": 10, "symbol": "circle-open", "line": {"width": 2}},
            showlegend=bool(spread.fragile.any()),
            hovertext=[hover[index] for index in np.flatnonzero(spread.fragile)],
            hoverinfo="text",
        )
        drawn.add_scatter(
            x=spread.frame_ids, y=100 * spread.registered, yaxis="y2", mode="lines", showlegend=False, **words
        ).data[-1].update(line={"color": colour, "shape": "hvh"})
    drawn.update_layout(
        xaxis=theme.axis("frame", anchor="y2"),
        yaxis=theme.axis("moved by [‰ of extent]", domain=[0.36, 1], rangemode="tozero"),
        yaxis2=theme.axis("registered [%]", domain=[0, 0.24], range=[-5, 105], tickvals=[0, 50, 100]),
    )
    return drawn


def _proportions(runs: Sequence[AlignedRun]) -> dict[str, float]:
    """Return the sides of the box around all runs, the longest being 1; none is drawn thinner than a twentieth."""
    positions = np.concatenate([run.positions for run in runs]) if runs else np.zeros((1, 3))
    sides = np.ptp(positions, axis=0)
    longest = float(sides.max()) or 1.0
    return {name: max(float(side) / longest, 0.05) for name, side in zip("xyz", sides, strict=True)}


def _height(aspect: float) -> int:
    """Return a height in pixels that leaves little white around a drawing whose height / width is ``aspect``."""
    return int(min(max(_WIDTH_PX * aspect + _SURROUNDINGS_PX, _LOWEST_PX), _HIGHEST_PX))


def _colours(run: AlignedRun, colours: tuple[float, float], *, is_last: bool) -> dict[str, Any]:
    bar = {
        "title": {"text": "‰ of extent", "side": "right", "font": {"size": 12}},
        "thickness": 12,
        "outlinewidth": 0,
        "len": 0.8,
    }
    return {
        "color": run.errors,
        "cmin": colours[0],
        "cmax": colours[1],
        "colorscale": theme.ERROR_SCALE,
        "showscale": is_last,
        **({"colorbar": bar} if is_last else {}),
    }


def _clean_words(run: AlignedRun) -> dict[str, Any]:
    return {"name": f"clean run {run.index}", "hoverinfo": "name"}


def _noisy_words(run: AlignedRun) -> dict[str, Any]:
    texts = [
        f"noisy run {run.index}, frame {frame}<br>{significant(float(error))} ‰ of extent"
        for frame, error in zip(run.frame_ids, run.errors, strict=True)
    ]
    return {"name": f"noisy run {run.index}", "hovertext": texts, "hoverinfo": "text"}


def _frame_text(spread: FrameSpread, index: int) -> str:
    return (
        f"{spread.title}, frame {spread.frame_ids[index]}<br>moved by {significant(float(spread.median[index]))} ‰ of "
        f"extent<br>registered in {100 * spread.registered[index]:.0f} % of the runs"
    )
