"""The runs of the compared trials, aligned to each other."""

from collections.abc import Sequence
from typing import Any

import numpy as np
import plotly.graph_objects as go

from gtf_tune.display import significant
from gtf_tune.report.aligned_runs import AlignedRun, align_runs, in_one_frame, known_errors
from gtf_tune.report.drawing import markup, theme
from gtf_tune.report.panels.base import Block, Drawing, Panel, ReportInput
from gtf_tune.report.panels.verdict import compared_trials
from gtf_tune.report.study_data import StudyData

_HIGHEST_PERCENTILE = 98
_MARKER_PX = 6
_WIDE_ASPECT = 0.5
_WIDE_PX, _HALF_PX = 1100, 520
_SURROUNDINGS_PX, _LOWEST_PX, _HIGHEST_PX = 135, 250, 640
_SCENE_PX = 500
_SIDE = {"title": {"text": ""}, "gridcolor": theme.GRID, "showbackground": False, "zeroline": False, "nticks": 5}
_LABELLED_SHARE = 0.25
_EYE = {"x": 0.5, "y": -0.75, "z": 0.5}
_CLEAN = {"color": "rgb(110,120,130)", "width": 2}
# Browsers keep at most 8 to 16 WebGL scenes of a page alive; each sequence takes two.
_MOST_SCENES = 4


def error_range(configurations: Sequence[Sequence[AlignedRun]]) -> tuple[float, float]:
    """Return the range of colours for several configurations: 0 to what all but 2 % of the errors stay below."""
    errors = np.concatenate([known_errors(runs) for runs in configurations]) if configurations else np.empty(0)
    return 0.0, float(np.percentile(errors, _HIGHEST_PERCENTILE)) if errors.size else 1.0


def scene_figure(runs: Sequence[AlignedRun], colours: tuple[float, float]) -> go.Figure:
    """Return the runs in 3-D, in units of the extent."""
    drawn = theme.figure(height=_SCENE_PX)
    for run in (run for run in runs if run.kind == "clean"):
        x, y, z = run.positions.T
        drawn.add_scatter3d(x=x, y=y, z=z, mode="lines", line=_CLEAN, **_clean_words(run))
    noisy = [run for run in runs if run.kind == "noisy"]
    for number, run in enumerate(noisy):
        x, y, z = run.positions.T
        marker = {"size": 2.5, **_colours(run, colours, is_last=number == len(noisy) - 1)}
        drawn.add_scatter3d(x=x, y=y, z=z, mode="markers", marker=marker, **_noisy_words(run))
    proportions = _proportions(runs)
    sides = {f"{name}axis": {**_SIDE, "showticklabels": share > _LABELLED_SHARE} for name, share in proportions.items()}
    drawn.update_layout(
        showlegend=False,
        margin={"l": 20, "r": 0, "t": 30, "b": 70},
        scene={**sides, "aspectmode": "manual", "aspectratio": proportions, "camera": {"eye": _EYE}},
    )
    return drawn


def top_figure(runs: Sequence[AlignedRun], colours: tuple[float, float]) -> go.Figure:
    """Return the runs seen along the direction in which the camera moved least, in units of the extent."""
    drawn = theme.figure(height=_height(_aspect(runs)))
    for run in (run for run in runs if run.kind == "clean"):
        drawn.add_scatter(x=run.positions[:, 0], y=run.positions[:, 1], mode="lines", line=_CLEAN, **_clean_words(run))
    noisy = [run for run in runs if run.kind == "noisy"]
    for number, run in enumerate(noisy):
        marker = {"size": _MARKER_PX, **_colours(run, colours, is_last=number == len(noisy) - 1)}
        drawn.add_scatter(
            x=run.positions[:, 0], y=run.positions[:, 1], mode="markers", marker=marker, **_noisy_words(run)
        )
    drawn.update_layout(
        showlegend=False,
        margin={"t": 34, "b": 95},
        xaxis=theme.axis("extents", constrain="domain"),
        yaxis=theme.axis("extents", scaleanchor="x", constrain="domain"),
    )
    return drawn


def trajectories_panel(report: ReportInput) -> list[Block]:
    """Return the aligned runs from the top and, for the first sequences, in 3-D."""
    blocks: list[Block] = []
    for number, (sequence, configurations) in enumerate(report.configurations.items()):
        aligned = [align_runs(runs) for runs in in_one_frame(configurations)]
        if not any(aligned):
            blocks.append(markup.missing(f"{sequence}: no clean run has poses that could be drawn."))
            continue
        thinned = [tuple(run.thinned(report.lengths.trajectory_points) for run in runs) for runs in aligned]
        colours = error_range(aligned)
        is_long = all(_aspect(runs) < _WIDE_ASPECT for runs in aligned)
        drawers = [("top view", top_figure), *([("3-D", scene_figure)] if number < _MOST_SCENES else [])]
        for words, draw in drawers:
            for configuration, runs in zip(configurations, thinned, strict=True):
                title = f"{sequence}, {configuration.title}: {words}"
                name, is_wide = f"{words} {sequence} {configuration.title}", draw is top_figure and is_long
                blocks.append(Drawing(name, title, draw(runs, colours), is_wide))
    return blocks or [markup.missing("No run has finished yet, so there is no trajectory to draw.")]


def _proportions(runs: Sequence[AlignedRun]) -> dict[str, float]:
    """Return the sides of the box around all runs, the longest being 1; none is drawn thinner than a twentieth."""
    positions = np.concatenate([run.positions for run in runs]) if runs else np.zeros((1, 3))
    sides = np.ptp(positions, axis=0)
    longest = float(sides.max()) or 1.0
    return {name: max(float(side) / longest, 0.05) for name, side in zip("xyz", sides, strict=True)}


def _aspect(runs: Sequence[AlignedRun]) -> float:
    """Return height / width of the runs seen from the top."""
    proportions = _proportions(runs)
    return proportions["y"] / proportions["x"]


def _height(aspect: float) -> int:
    """Return a height in pixels that leaves little white around a drawing whose height / width is ``aspect``."""
    width = _WIDE_PX if aspect < _WIDE_ASPECT else _HALF_PX
    return int(min(max(width * aspect + _SURROUNDINGS_PX, _LOWEST_PX), _HIGHEST_PX))


def _colours(run: AlignedRun, colours: tuple[float, float], *, is_last: bool) -> dict[str, Any]:
    return {
        "color": run.errors,
        "cmin": colours[0],
        "cmax": colours[1],
        "colorscale": theme.ERROR_SCALE,
        "showscale": is_last,
        **({"colorbar": theme.colour_bar("moved by [‰ of extent]")} if is_last else {}),
    }


def _clean_words(run: AlignedRun) -> dict[str, Any]:
    return {"name": f"clean run {run.index}", "hoverinfo": "name"}


def _noisy_words(run: AlignedRun) -> dict[str, Any]:
    texts = [
        f"noisy run {run.index}, frame {frame}<br>{significant(float(error))} ‰ of extent"
        for frame, error in zip(run.frame_ids, run.errors, strict=True)
    ]
    return {"name": f"noisy run {run.index}", "hovertext": texts, "hoverinfo": "text"}


def _lead(data: StudyData) -> str:
    names = [f"trial {number} ({name})" for name, number in compared_trials(data)]
    return (
        f"All runs of {' and of '.join(names)}, aligned to the first clean run of each. Lines are clean runs; "
        "dots are noisy runs, coloured by their distance from the clean ones."
    )


PANEL = Panel("Trajectories", trajectories_panel, _lead)
