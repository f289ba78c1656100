"""The figures of a report as images for papers."""

import importlib.util
from collections.abc import Sequence
from pathlib import Path

import plotly.io

from gtf_tune.errors import DefinitionError
from gtf_tune.report.drawing.markup import figure_id
from gtf_tune.report.html import Section
from gtf_tune.report.panels.base import Drawing

_WIDTH_PX = 800
_WIDE_PX = 1200
_SCALE = 3


def write_images(folder: Path, sections: Sequence[Section]) -> list[Path]:
    """Write every figure of the sections as a PNG file into a folder, and return the files.

    Raises
    ------
    DefinitionError
        Kaleido or the browser that it needs is missing, or the folder cannot be written.
    """
    require_kaleido()
    drawings = [block for section in sections for block in section.blocks if isinstance(block, Drawing)]
    paths = [folder / f"{figure_id(drawing.name)}.png" for drawing in drawings]
    try:
        folder.mkdir(parents=True, exist_ok=True)
        if drawings:
            _write(paths, drawings)
    except (RuntimeError, OSError, ValueError) as error:
        reason = " ".join(str(error).split())[:200]
        raise DefinitionError(
            f"the figures could not be written to {folder} ({reason}); give a folder that can be written with -o, and "
            "install Chrome or Chromium, which kaleido draws with"
        ) from error
    return paths


def require_kaleido() -> None:
    """Raise `DefinitionError` with the command that installs what PNG files need."""
    if importlib.util.find_spec("kaleido") is None:
        raise DefinitionError("PNG files need the package 'kaleido'; install it with: pip install 'gtf-tune[png]'")


def _write(paths: Sequence[Path], drawings: Sequence[Drawing]) -> None:
    plotly.io.write_images(
        fig=[drawing.figure for drawing in drawings],
        file=[str(path) for path in paths],
        format="png",
        width=[_WIDE_PX if drawing.is_wide else _WIDTH_PX for drawing in drawings],
        height=[drawing.figure.layout.height for drawing in drawings],
        scale=_SCALE,
    )
