"""The sparse models that were made with the compared configurations: coloured points and cameras, in the same view."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
import plotly.graph_objects as go

from gtf_tune.display import count, significant
from gtf_tune.errors import TrajectoryError
from gtf_tune.report.drawing import theme
from gtf_tune.report.panels.base import Block, Drawing, Panel, ReportInput
from gtf_tune.trajectory import FloatArray
from gtf_tune.trajectory.alignment import Similarity, umeyama

if TYPE_CHECKING:
    from gtf_tune.pipelines.colmap.clouds import SparseCloud

_HEIGHT_PX = 460
_NEAR_PERCENTILE = 90
_REACH = 2.5
_DIGITS = 4
_CAMERA_SIZE = 0.12
_EYE = {"x": 0.25, "y": -1.0, "z": 0.4}
LINKED = "linked"
"""Value of ``layout.meta`` of scenes that turn together."""


@dataclass(frozen=True, eq=False)
class SeenModel:
    """A model as it is drawn: x to the right, y forward and z up, in the unit of the scene.

    ``points`` are (n, 3) with their ``colours`` as words, ``cameras`` (m, 5, 3) the centre and the corners of each.
    """

    points: FloatArray
    colours: tuple[str, ...]
    cameras: FloatArray
    names: tuple[str, ...]


def seen_alike(models: Sequence["SparseCloud"]) -> list[SeenModel]:
    """Return models in the frame of the first one's view, each laid on it by the camera centres that both have."""
    first = models[0]
    view = _view(first)
    return [_seen(model, _onto(first, model), view) for model in models]


def model_figure(model: SeenModel, limits: FloatArray) -> go.Figure:
    """Return one model; ``limits`` are the (2, 3) lowest and highest coordinates that are drawn."""
    drawn = theme.figure(height=_HEIGHT_PX)
    x, y, z = np.round(model.points, _DIGITS).T
    drawn.add_scatter3d(
        x=x, y=y, z=z, mode="markers", marker={"size": 1.5, "color": model.colours}, hoverinfo="skip", name="points"
    )
    x, y, z = np.round(_frustum_lines(model.cameras), _DIGITS).T
    drawn.add_scatter3d(
        x=x, y=y, z=z, mode="lines", line={"color": theme.WRONG, "width": 2}, hoverinfo="skip", name="cameras"
    )
    x, y, z = np.round(model.cameras[:, 0], _DIGITS).T
    marker = {"size": 2, "color": theme.WRONG}
    drawn.add_scatter3d(
        x=x, y=y, z=z, mode="markers", marker=marker, hovertext=model.names, hoverinfo="text", name="images"
    )
    sides = np.ptp(limits, axis=0)
    axes = {
        f"{name}axis": {"visible": False, "showbackground": False, "range": limits[:, place].round(_DIGITS).tolist()}
        for place, name in enumerate("xyz")
    }
    ratio = {name: float(side / sides.max()) for name, side in zip("xyz", sides, strict=True)}
    drawn.update_layout(
        showlegend=False,
        meta=LINKED,
        margin={"l": 0, "r": 0, "t": 30, "b": 0},
        scene={**axes, "aspectmode": "manual", "aspectratio": ratio, "camera": {"eye": _EYE}},
    )
    return drawn


def models_panel(report: ReportInput) -> list[Block]:
    """Return the models side by side; nothing where none was made."""
    return list(model_drawings(report.models)) if report.models else []


def model_drawings(models: Mapping[str, "SparseCloud"]) -> list[Drawing]:
    """Return a figure of each model, by title; all show the same part of space from the same side."""
    seen = seen_alike(list(models.values()))
    limits = _limits(seen)
    return [
        Drawing(f"model {title}", f"{title}: {_words(cloud)}", model_figure(model, limits))
        for (title, cloud), model in zip(models.items(), seen, strict=True)
    ]


def _words(cloud: "SparseCloud") -> str:
    images, points = count(len(cloud.names), "image"), f"{cloud.num_points:,} points"
    return f"{images}, {points}, mean reprojection error {significant(cloud.error_px)} px"


def _limits(seen: Sequence[SeenModel]) -> FloatArray:
    everything = np.concatenate([np.concatenate([model.points, model.cameras.reshape(-1, 3)]) for model in seen])
    return np.array([everything.min(axis=0), everything.max(axis=0)])


@dataclass(frozen=True, eq=False)
class _View:
    origin: FloatArray
    rotation: FloatArray
    unit: float

    def seen(self, positions: FloatArray) -> FloatArray:
        found: FloatArray = (positions - self.origin) @ self.rotation.T / self.unit
        return found


def _view(model: "SparseCloud") -> _View:
    """Return the view in which the cameras are upright and look forward, on the whole."""
    up = _unit(-model.axes[:, 1].mean(axis=0), np.array([0.0, -1.0, 0.0]))
    forward = model.axes[:, 2].mean(axis=0)
    forward = _unit(forward - up * (forward @ up), model.axes[0, 2] - up * (model.axes[0, 2] @ up))
    rotation = np.array([np.cross(forward, up), forward, up])
    positions = model.points if len(model.points) else model.centres
    origin = np.median(positions, axis=0)
    distances = np.linalg.norm(positions - origin, axis=1)
    return _View(origin, rotation, float(np.percentile(distances, _NEAR_PERCENTILE)) or 1.0)


def _unit(vector: FloatArray, otherwise: FloatArray) -> FloatArray:
    """Return a vector of length 1, along ``otherwise`` where the first has hardly any direction."""
    chosen = vector if np.linalg.norm(vector) > 1e-3 else otherwise
    return np.asarray(chosen / (np.linalg.norm(chosen) or 1.0))


def _onto(target: "SparseCloud", model: "SparseCloud") -> Similarity:
    places = {name: place for place, name in enumerate(target.names)}
    common = [(places[name], place) for place, name in enumerate(model.names) if name in places]
    if model is target or not common:
        return Similarity.identity()
    there, here = (np.array(side) for side in zip(*common, strict=True))
    try:
        return umeyama(model.centres[here], target.centres[there], "sim3")
    except TrajectoryError:
        return Similarity.identity()


def _seen(model: "SparseCloud", similarity: Similarity, view: _View) -> SeenModel:
    points = view.seen(similarity.apply(model.points))
    near = np.linalg.norm(points, axis=1) < _REACH
    centres = view.seen(similarity.apply(model.centres))
    corners = model.corners @ similarity.rotation.T @ view.rotation.T
    cameras = np.concatenate([centres[:, None], centres[:, None] + _CAMERA_SIZE * corners], axis=1)
    colours = tuple("#{:02x}{:02x}{:02x}".format(*colour) for colour in model.colours[near].tolist())
    return SeenModel(points[near], colours, cameras, model.names)


def _frustum_lines(cameras: FloatArray) -> FloatArray:
    """Return one line through the edges of every frustum, with NaN between cameras."""
    path = [0, 1, 2, 0, 3, 4, 0, 2, 3]
    more = [4, 1]
    gap = np.full((len(cameras), 1, 3), np.nan)
    return np.concatenate([cameras[:, path], gap, cameras[:, more], gap], axis=1).reshape(-1, 3)


PANEL = Panel(
    "The reconstruction",
    models_panel,
    "The sparse model of all images with each set of options: points in the colours of the images, cameras in red, "
    "laid on each other and seen from the same side. At most 4,000 points of each are drawn.",
)
