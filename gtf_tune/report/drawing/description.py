"""Descriptions of figures in words, for those who cannot see them."""

import re
from typing import Any

from gtf_tune.report.panels.base import Drawing

_TAG = re.compile(r"<[^>]*>")


def description(drawing: Drawing) -> str:
    """Return what a figure shows: its title, its axes, and its named parts with the number of their points."""
    layout = drawing.figure.layout
    titles = [layout[name].title.text for name in ("xaxis", "yaxis", "yaxis2") if name in layout]
    axes = [_plain(title) for title in titles if title]
    parts = [_part(trace) for trace in drawing.figure.data if trace.name]
    sentences = [
        drawing.title or drawing.name,
        f"Axes: {', '.join(axes)}" if axes else "",
        f"Shown: {', '.join(dict.fromkeys(parts))}" if parts else "",
    ]
    return ". ".join(sentence for sentence in sentences if sentence)


def _part(trace: Any) -> str:
    points = len(trace.x) if getattr(trace, "x", None) is not None else 0
    return f"{_plain(trace.name)} ({points} points)" if points > 1 else _plain(trace.name)


def _plain(words: str) -> str:
    return " ".join(_TAG.sub(" ", words).split())
