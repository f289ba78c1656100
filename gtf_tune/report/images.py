"""Write the figures of a report as images for papers."""

import importlib.util
from collections.abc import Sequence
from pathlib import Path

from gtf_tune.errors import DefinitionError
from gtf_tune.report.html import Section, figure_id
from gtf_tune.report.panels.blocks import Drawing

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
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise DefinitionError(f"{folder} cannot be made ({error.strerror}); give another folder with -o") from error
    drawings = [block for section in sections for block in section.blocks if isinstance(block, Drawing)]
    return [_written(folder / f"{figure_id(drawing.name)}.png", drawing) for drawing in drawings]


def require_kaleido() -> None:
    """Raise `DefinitionError` with the command that installs what PNG files need."""
    if importlib.util.find_spec("kaleido") is None:
        raise DefinitionError("PNG files need the package 'kaleido'; install it with: pip install 'gtf-tune[png]'")


def _written(path: Path, drawing: Drawing) -> Path:
    width = _WIDE_PX if drawing.is_wide else _WIDTH_PX
    try:
        drawing.figure.write_image(str(path), format="png", width=width, scale=_SCALE)
    except (RuntimeError, OSError, ValueError) as error:
        reason = " ".join(str(error).split())[:200]
        raise DefinitionError(
            f"{path.name} could not be drawn ({reason}); kaleido needs Chrome or Chromium: install one, or run "
            "plotly_get_chrome"
        ) from error
    return path
