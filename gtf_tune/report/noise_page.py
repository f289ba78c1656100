"""Write what ``gtf-tune noise`` measured as one HTML page."""

from pathlib import Path

from gtf_tune.errors import DefinitionError
from gtf_tune.report.figures.noise import draw_score, draw_squares
from gtf_tune.report.html import PageHead, Section, render_page
from gtf_tune.report.panels.blocks import Drawing
from gtf_tune.study.noise.choice import NoiseScale
from gtf_tune.version import __version__

_TEXT = (
    "Left: the score over the noise; the shaded range is linear, the dashed line is the recommended noise, red levels "
    "have runs that collapsed or failed. Right: squares, which add up for independent causes, in the linear range."
)


def write_noise_page(path: Path, scale: NoiseScale, sequence: str, pipeline: str) -> None:
    """Write the figures of a noise scale to a file that works offline.

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
    page = render_page(
        PageHead("Noise level", sequence, facts, __version__), [Section("noise", "Linearity", _TEXT, drawings)]
    )
    try:
        path.write_text(page, encoding="utf-8")
    except OSError as error:
        raise DefinitionError(f"{path} cannot be written ({error.strerror}); give another file") from error
