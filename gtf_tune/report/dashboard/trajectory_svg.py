"""The trajectories of one trial as a small SVG image, which needs no browser and no other package."""

from collections.abc import Sequence
from html import escape

import numpy as np
from plotly.colors import sample_colorscale

from gtf_tune.display import significant
from gtf_tune.report.aligned_runs import AlignedRun, known_errors
from gtf_tune.report.drawing import theme
from gtf_tune.trajectory import FloatArray

_SIDE_PX = 480
_MARGIN_PX = 34
_LEVELS = 12
_MOST_POSES = 120
_HIGHEST_PERCENTILE = 98


def trajectory_svg(runs: Sequence[AlignedRun], title: str) -> bytes:
    """Return the runs seen from the top, noisy poses coloured by how far they moved; at least one run is given."""
    thinned = [run.thinned(_MOST_POSES) for run in runs]
    placed = _Frame.around(thinned)
    errors = known_errors(thinned)
    highest = float(np.percentile(errors, _HIGHEST_PERCENTILE)) if errors.size else 1.0
    parts = [
        f'<svg xmlns="http://www.w3.org/2000/svg" width="{_SIDE_PX}" height="{placed.height}" '
        f'viewBox="0 0 {_SIDE_PX} {placed.height}" font-family="Helvetica, Arial, sans-serif" font-size="13">',
        '<rect width="100%" height="100%" fill="white"/>',
        *(_line(placed.pixels(run.positions)) for run in thinned if run.kind == "clean"),
        *(_dots(placed.pixels(run.positions), run.errors / highest) for run in thinned if run.kind == "noisy"),
        f'<text x="10" y="20" fill="{theme.INK}">{escape(title)}</text>',
        f'<text x="10" y="{placed.height - 10}" fill="{theme.FAINT}">colour: moved by 0 to {significant(highest)} ‰ of '
        "extent</text></svg>",
    ]
    return "\n".join(parts).encode()


class _Frame:
    """Mapping of positions in extents to pixels, with the same scale along both axes."""

    def __init__(self, low: FloatArray, scale: float, height: int) -> None:
        self._low = low
        self._scale = scale
        self.height = height

    @classmethod
    def around(cls, runs: Sequence[AlignedRun]) -> "_Frame":
        positions = np.concatenate([run.positions[:, :2] for run in runs])
        low, sides = positions.min(axis=0), np.ptp(positions, axis=0)
        scale = (_SIDE_PX - 2 * _MARGIN_PX) / (float(sides.max()) or 1.0)
        return cls(low, scale, max(int(sides[1] * scale) + 2 * _MARGIN_PX + 10, 4 * _MARGIN_PX))

    def pixels(self, positions: FloatArray) -> FloatArray:
        pixels: FloatArray = (positions[:, :2] - self._low) * self._scale + _MARGIN_PX
        pixels[:, 1] = self.height - pixels[:, 1]
        return pixels


def _line(pixels: FloatArray) -> str:
    points = " ".join(f"{x:.1f},{y:.1f}" for x, y in pixels)
    return f'<polyline points="{points}" fill="none" stroke="rgb(150,160,170)" stroke-width="1.5"/>'


def _dots(pixels: FloatArray, shares: FloatArray) -> str:
    """Return the poses of one run, those of one colour in one path: lines of length 0 with round ends are dots."""
    colours = sample_colorscale(theme.ERROR_SCALE, [level / (_LEVELS - 1) for level in range(_LEVELS)])
    levels = (np.clip(np.nan_to_num(shares), 0, 1) * (_LEVELS - 1)).round().astype(int)
    paths = []
    for level in np.unique(levels):
        path = "".join(f"M{x:.1f},{y:.1f}h0" for x, y in pixels[levels == level])
        paths.append(f'<path d="{path}" stroke="{colours[level]}" stroke-width="4" stroke-linecap="round"/>')
    return "".join(paths)
