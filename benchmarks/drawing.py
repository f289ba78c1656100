"""Write figures of the documentation as SVG files."""

import importlib.util
import re
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
        paths = [folder / f"{name}.svg" for name in found]
        plotly.io.write_images(
            list(found.values()),
            [str(path) for path in paths],
            format="svg",
            width=WIDTH_PX,
            height=[figure.layout.height for figure in found.values()],
        )
        for path in paths:
            path.write_text(without_chance(path.read_text(encoding="utf-8"), path.stem), encoding="utf-8")
    return list(found)


def without_chance(svg: str, name: str) -> str:
    """Return a drawing of Plotly whose random identifier is ``name``: the same figure is the same file."""
    drawn = re.search(r'id="defs-([0-9a-f]{6})"', svg)
    return svg if drawn is None else svg.replace(drawn[1], name)
