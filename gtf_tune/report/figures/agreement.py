"""Draw how two measures of the same trials go together."""

import math

import plotly.graph_objects as go

from gtf_tune.display import significant
from gtf_tune.report.figures import theme
from gtf_tune.report.tables.agreement import Agreement


def agreement_figure(found: Agreement, labels: tuple[str, str], colour: str) -> go.Figure:
    """Return a scatter with its regression line; ``labels`` are the titles of the axes."""
    drawn = theme.figure(height=360)
    types = ["log" if is_log else "linear" for is_log in found.is_log]
    drawn.update_layout(
        showlegend=False,
        margin={"t": 15},
        xaxis=theme.axis(labels[0], type=types[0], **({"dtick": 1} if types[0] == "log" else {})),
        yaxis=theme.axis(labels[1], type=types[1], **({"dtick": 1} if types[1] == "log" else {})),
    )
    if math.isfinite(found.slope):
        x, y = found.line()
        seen = [(a, b) for a, b in zip(x, y, strict=True) if b > 0 or not found.is_log[1]]
        drawn.add_scatter(
            x=[a for a, _ in seen],
            y=[b for _, b in seen],
            mode="lines",
            line={"color": theme.FAINT, "width": 1.5, "dash": "dash"},
            hoverinfo="skip",
        )
    drawn.add_scatter(
        x=found.x,
        y=found.y,
        mode="markers",
        marker={
            "color": [theme.NOMINAL if ordinal == 0 else colour for ordinal in found.ordinals],
            "size": [11 if ordinal == 0 else 8 for ordinal in found.ordinals],
            "line": {"color": "white", "width": 1},
        },
        hovertext=[_text(found, index, labels) for index in range(len(found.ordinals))],
        hoverinfo="text",
    )
    return drawn


def merit_text(found: Agreement) -> str:
    """Return the figures of merit of an agreement."""
    if not math.isfinite(found.r_squared):
        return f"{len(found.ordinals)} trials; one side is constant, so there is no correlation"
    return f"R² {found.r_squared:.2f}, Spearman {found.spearman:.2f} ({len(found.ordinals)} trials)"


def _text(found: Agreement, index: int, labels: tuple[str, str]) -> str:
    ordinal = found.ordinals[index]
    name = "trial 0 (nominal)" if ordinal == 0 else f"trial {ordinal}"
    return "<br>".join(
        [
            f"<b>{name}</b>",
            f"{labels[0]}: {significant(float(found.x[index]), 4)}",
            f"{labels[1]}: {significant(float(found.y[index]), 4)}",
        ]
    )
