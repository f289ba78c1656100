"""Write figures of the documentation as SVG files."""

import importlib.util
from collections.abc import Mapping
from pathlib import Path

import plotly.graph_objects as go
import plotly.io

WIDTH_PX = 900


def write_svgs(figures: Mapping[str, go.Figure], folder: Path) -> list[str]:
    """Write the figures that have data into ``folder``, named by their keys, and return these; none without kaleido."""
    if importlib.util.find_spec("kaleido") is None:
        print("figures are not drawn: they need kaleido and Chromium; install the first with: pip install -e '.[png]'")
        return []
    found = {name: figure for name, figure in figures.items() if figure.data}
    if found:
        folder.mkdir(parents=True, exist_ok=True)
        paths = [str(folder / f"{name}.svg") for name in found]
        plotly.io.write_images(list(found.values()), paths, format="svg", width=WIDTH_PX)
    return list(found)
