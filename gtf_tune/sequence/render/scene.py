"""Build the synthetic room from flat faces."""

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from gtf_tune.sequence.render.textures import (
    Painter,
    Texture,
    bricks,
    carton,
    fractal_noise,
    planks,
    plaster,
    poster,
    shelf,
    wallpaper,
)

FloatArray = NDArray[np.float64]
Point = tuple[float, float, float]

ROOM_SIZE_M: Point = (6.0, 5.0, 2.8)
TEXELS_PER_M = 220


@dataclass(frozen=True, eq=False)
class Face:
    """Flat parallelogram: the points ``corner + u * right + v * down`` with u, v in [0, 1], in metres.

    Column 0 of the texture is at u = 0, row 0 at v = 0.
    """

    corner: FloatArray
    right: FloatArray
    down: FloatArray
    texture: Texture

    def with_contrast(self, contrast: float) -> "Face":
        """Return the face with its texture scaled about its mean; 1 leaves every texel as it is."""
        if contrast == 1:
            return self
        mean = self.texture.mean()
        return replace(self, texture=mean + np.float32(contrast) * (self.texture - mean))


def build_room(rng: np.random.Generator) -> tuple[Face, ...]:
    """Return the faces of a furnished room; x to the right, y to the back wall, z up."""
    return (*_walls(rng), *_pictures(rng), *_furniture(rng))


def _face(corner: Point, right: Point, down: Point, painter: Painter, rng: np.random.Generator) -> Face:
    across, along = np.array(right), np.array(down)
    width, height = (max(8, round(float(np.linalg.norm(edge)) * TEXELS_PER_M)) for edge in (across, along))
    texture = painter(height, width, rng) * _light(height, width, rng)
    return Face(np.array(corner), across, along, np.clip(texture, 0, 255).astype(np.float32))


def _light(height: int, width: int, rng: np.random.Generator) -> Texture:
    """Return a smooth field around the face's own brightness, as lamps make it."""
    slope = rng.uniform(-0.15, 0.15, 2)
    rows, columns = np.linspace(-1, 1, height)[:, None], np.linspace(-1, 1, width)[None]
    return np.asarray(rng.uniform(0.8, 1.1) + slope[0] * rows + slope[1] * columns, dtype=np.float32)


def _ceiling(height: int, width: int, rng: np.random.Generator) -> Texture:
    return 190 + 7 * fractal_noise(height, width, rng)


def _walls(rng: np.random.Generator) -> tuple[Face, ...]:
    x, y, z = ROOM_SIZE_M
    return (
        _face((0, y, z), (x, 0, 0), (0, 0, -z), bricks, rng),
        _face((0, 0, z), (0, y, 0), (0, 0, -z), wallpaper, rng),
        _face((x, y, z), (0, -y, 0), (0, 0, -z), plaster, rng),
        _face((x, 0, z), (-x, 0, 0), (0, 0, -z), plaster, rng),
        _face((0, y, 0), (x, 0, 0), (0, -y, 0), planks, rng),
        _face((0, 0, z), (x, 0, 0), (0, y, 0), _ceiling, rng),
    )


def _pictures(rng: np.random.Generator) -> tuple[Face, ...]:
    """Hang posters a centimetre before the walls; one of them three times, as a chain of shops would."""
    x, y, _ = ROOM_SIZE_M
    gap = 0.01
    own = (
        _face((0.5, y - gap, 2.3), (0.9, 0, 0), (0, 0, -1.1), poster, rng),
        _face((x - gap, 3.2, 2.2), (0, -0.8, 0), (0, 0, -1.0), poster, rng),
        _face((gap, 1.7, 2.3), (0, 1.1, 0), (0, 0, -0.8), poster, rng),
    )
    print_ = _face((2.6, y - gap, 2.2), (0.6, 0, 0), (0, 0, -0.8), poster, rng)
    copies = (
        Face(np.array((4.6, y - gap, 2.2)), print_.right, print_.down, print_.texture),
        Face(np.array((x - gap, 4.6, 2.2)), np.array((0, -0.6, 0)), print_.down, print_.texture),
    )
    return (*own, print_, *copies)


def _furniture(rng: np.random.Generator) -> tuple[Face, ...]:
    return (
        *_box((3.4, 4.55, 0), (1.6, 0.4, 1.9), 0, shelf, rng),
        *_box((1.2, 3.6, 0), (1.0, 0.7, 0.75), 15, planks, rng),
        *_box((1.5, 3.8, 0.75), (0.45, 0.3, 0.35), 40, carton, rng),
        *_box((2.7, 3.1, 0), (0.5, 0.5, 0.5), -25, carton, rng),
        *_box((4.2, 3.2, 0), (0.7, 0.6, 0.6), 10, carton, rng),
        *_box((4.35, 3.35, 0.6), (0.4, 0.4, 0.3), 35, carton, rng),
        *_box((0.1, 2.9, 0), (0.45, 0.9, 1.3), 0, shelf, rng),
    )


def _box(corner: Point, size: Point, turn_deg: float, painter: Painter, rng: np.random.Generator) -> tuple[Face, ...]:
    """Return the four sides and the top of a box that stands turned about the vertical through its corner."""
    angle = np.deg2rad(turn_deg)
    x, y = size[0] * np.array((np.cos(angle), np.sin(angle), 0)), size[1] * np.array((-np.sin(angle), np.cos(angle), 0))
    top = np.add(corner, (0, 0, size[2]))
    down = (0.0, 0.0, -size[2])
    corners_and_edges = ((top, x, down), (top + x, y, down), (top + x + y, -x, down), (top + y, -y, down), (top, x, y))
    return tuple(_face(tuple(at), tuple(right), tuple(low), painter, rng) for at, right, low in corners_and_edges)
