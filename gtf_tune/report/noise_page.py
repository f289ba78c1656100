"""The measurements of ``gtf-tune noise`` as one HTML page."""

import math
from pathlib import Path

import plotly.graph_objects as go

from gtf_tune.errors import DefinitionError
from gtf_tune.report.drawing import theme
from gtf_tune.report.html import PageHead, Section, render_page
from gtf_tune.report.panels.base import Drawing
from gtf_tune.study.ground_truth.linearity import TrueErrors
from gtf_tune.study.noise.choice import NoiseLevel
from gtf_tune.study.noise.ladder import Line, NoiseScale
from gtf_tune.version import __version__

_TEXT = (
    "Left: the score over the noise; the shaded range is linear, the dashed line is the recommended noise, red levels "
    "have runs that collapsed or failed. Right: squares, which add up for independent causes, in the linear range. "
    "Where there is ground truth: the true error, with the line through its first values."
)
_PERMILLE = 1000.0


def write_noise_page(
    path: Path, scale: NoiseScale, sequence: str, pipeline: str, truth: TrueErrors | None = None
) -> None:
    """Write the figures of a noise scale to a file that works offline, with the true errors where they are known.

    Raises
    ------
    DefinitionError
        The file cannot be written.
    """
    facts = (f"pipeline {pipeline}", f"recommended sigma {scale.recommended:g} grey levels", scale.reason)
    drawings = [
        Drawing("noise-score", "Score over sigma", draw_score(scale)),
        Drawing("noise-squares", "Score² over sigma²", draw_squares(scale)),
    ]
    if truth is not None:
        drawings.append(Drawing("noise-truth", "True ATE over sigma", draw_truth(truth)))
    page = render_page(
        PageHead("Noise level", sequence, facts, __version__), [Section("noise", "Linearity", _TEXT, drawings)]
    )
    try:
        path.write_text(page, encoding="utf-8", errors="backslashreplace")
    except OSError as error:
        raise DefinitionError(f"{path} cannot be written ({error.strerror}); give another file") from error


def draw_score(scale: NoiseScale) -> go.Figure:
    """Draw score against sigma with the line fitted in the linear range; bars are the spread between instances."""
    figure = theme.figure()
    ends = _linear_end(scale)
    if ends > 0:
        figure.add_vrect(x0=0, x1=ends, fillcolor=theme.GTF_BAND, line_width=0, layer="below")
    levels = [scale.floor, *scale.levels]
    figure.add_trace(_points(levels, 1, scale))
    figure.add_trace(_fitted(scale.score_line, ends, _PERMILLE))
    figure.add_vline(x=scale.recommended, line={"color": theme.NOMINAL, "dash": "dash", "width": 1})
    figure.update_xaxes(**theme.axis("sigma [grey levels]", rangemode="tozero"))
    figure.update_yaxes(**theme.axis("GTF ATE [‰ of the extent]", rangemode="tozero"))
    return figure


def draw_squares(scale: NoiseScale) -> go.Figure:
    """Draw score^2 against sigma^2, where independent causes add up, so that the linear range is a straight line."""
    figure = theme.figure()
    levels = [scale.floor, *(level for level, inside in zip(scale.levels, scale.linear, strict=True) if inside)]
    figure.add_trace(_points(levels, 2, scale))
    figure.add_trace(_fitted(scale.square_line, max(level.sigma for level in levels) ** 2, _PERMILLE**2))
    figure.update_xaxes(**theme.axis("sigma² [grey levels²]", rangemode="tozero"))
    figure.update_yaxes(**theme.axis("GTF ATE² [‰²]", rangemode="tozero"))
    return figure


def draw_truth(truth: TrueErrors) -> go.Figure:
    """Draw the true error against sigma with the line through its first values (the paper's figure on linearity)."""
    figure = theme.figure()
    errors = [error if math.isfinite(error) else None for error in truth.errors]
    marker = {"color": theme.GROUND_TRUTH, "size": 9}
    figure.add_scatter(x=truth.sigmas, y=errors, mode="markers", name="true ATE", marker=marker)
    line = _fitted(truth.line, max(truth.sigmas), 1.0)
    figure.add_trace(line.update(name="first values" + line.name.removeprefix("linear range"), line_dash="dash"))
    figure.update_xaxes(**theme.axis("sigma [grey levels]", rangemode="tozero"))
    figure.update_yaxes(**theme.axis("true ATE [unit of the ground truth]", rangemode="tozero"))
    return figure


def _linear_end(scale: NoiseScale) -> float:
    return max((level.sigma for level, inside in zip(scale.levels, scale.linear, strict=True) if inside), default=0.0)


def _points(levels: list[NoiseLevel], power: int, scale: NoiseScale) -> go.Scatter:
    """Return the levels as points (sigma^power, score^power in per mille)."""
    colours = [_colour(level, scale) for level in levels]
    values = [(_PERMILLE * level.score) ** power if math.isfinite(level.score) else None for level in levels]
    # The relative spread of a power is that many times the relative spread.
    spreads = [power * level.spread if math.isfinite(level.spread) else 0.0 for level in levels]
    return go.Scatter(
        x=[level.sigma**power for level in levels],
        y=values,
        error_y={
            "array": [(value or 0.0) * spread for value, spread in zip(values, spreads, strict=True)],
            "color": theme.FAINT,
            "thickness": 1,
        },
        mode="markers",
        marker={"size": 10, "color": colours},
        text=[_label(level) for level in levels],
        hovertemplate="%{text}<extra></extra>",
        showlegend=False,
    )


def _colour(level: NoiseLevel, scale: NoiseScale) -> str:
    if level.collapsed or level.failed:
        return theme.WRONG
    return theme.NOMINAL if level.sigma == scale.recommended else theme.GTF


def _label(level: NoiseLevel) -> str:
    return (
        f"sigma {level.sigma:g}: {_PERMILLE * level.score:.3g} ‰, "
        f"{level.collapsed} collapsed and {level.failed} failed of {level.runs}"
    )


def _fitted(line: Line, end: float, factor: float) -> go.Scatter:
    label = f"linear range, R² {line.r_squared:.2f}" if math.isfinite(line.r_squared) else "linear range"
    ends = [0.0, end] if math.isfinite(line.slope) else []
    return go.Scatter(
        x=ends,
        y=[factor * (line.intercept + line.slope * end) for end in ends],
        mode="lines",
        name=label,
        line={"color": theme.GTF_DARK},
        showlegend=True,
    )
