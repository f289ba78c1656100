"""Paint the surfaces of the synthetic room.

Every texture is a float32 image of grey levels, painted from one random generator; texels have one size on
all faces.
"""

from collections.abc import Callable

import cv2
import numpy as np
from numpy.typing import NDArray

Texture = NDArray[np.float32]
Painter = Callable[[int, int, np.random.Generator], Texture]

_GLYPH = (7, 5)


def fractal_noise(height: int, width: int, rng: np.random.Generator, octaves: int = 7) -> Texture:
    """Return noise of shape (height, width), zero mean, unit deviation, with the 1/f spectrum of natural images."""
    total = np.zeros((height, width), np.float32)
    for octave in range(octaves):
        cell = 2 ** (octaves - octave)
        grid = rng.standard_normal((height // cell + 3, width // cell + 3), dtype=np.float32)
        size = (grid.shape[1] * cell, grid.shape[0] * cell)
        smooth = cv2.resize(grid, size, interpolation=cv2.INTER_CUBIC)
        shift = rng.integers(0, cell, 2)
        total += 0.55**octave * smooth[shift[0] : shift[0] + height, shift[1] : shift[1] + width]
    total -= total.mean()
    return total / max(float(total.std()), 1e-6)


def plaster(height: int, width: int, rng: np.random.Generator) -> Texture:
    """Paint a wall of rough plaster with stains and cracks."""
    image = 150 + 16 * fractal_noise(height, width, rng)
    for _ in range(height * width // 40_000 + 2):
        steps = rng.normal(0, 14, (12, 2)).cumsum(axis=0) + rng.uniform(0, [width, height])
        cv2.polylines(image, [steps.astype(np.int32)], False, float(rng.uniform(60, 120)), 1)
    return image


def bricks(height: int, width: int, rng: np.random.Generator) -> Texture:
    """Paint a brick wall: one size of brick, each of its own tone."""
    rows, columns, mortar = 18, 48, 3
    image = 165 + 8 * fractal_noise(height, width, rng)
    for row, top in enumerate(range(0, height, rows)):
        for left in range(-(row % 2) * columns // 2, width, columns):
            tone = float(rng.normal(105, 18))
            corner = (left + columns - mortar, top + rows - mortar)
            cv2.rectangle(image, (left, top), corner, tone, -1)
    return image + 7 * fractal_noise(height, width, rng)


def planks(height: int, width: int, rng: np.random.Generator) -> Texture:
    """Paint a wooden floor: boards with grain along them."""
    image = np.empty((height, width), np.float32)
    board = 36
    for top in range(0, height, board):
        rows = min(board, height - top)
        grain = cv2.resize(fractal_noise(rows, width // 8 + 2, rng, 4), (width, rows), interpolation=cv2.INTER_LINEAR)
        image[top : top + rows] = rng.normal(120, 12) + 12 * grain
        image[top : top + 2] = 50
        for joint in rng.integers(0, width, width // 300 + 1):
            image[top : top + rows, joint : joint + 2] = 55
    return image + 4 * fractal_noise(height, width, rng, 4)


def wallpaper(height: int, width: int, rng: np.random.Generator) -> Texture:
    """Paint a wall with one motif again and again, exactly: what makes features match wrongly."""
    cell = 64
    motif = np.full((cell, cell), 150, np.float32)
    for _ in range(9):
        centre = tuple(int(value) for value in rng.integers(10, cell - 10, 2))
        axes = tuple(int(value) for value in rng.integers(3, 10, 2))
        cv2.ellipse(motif, centre, axes, float(rng.uniform(0, 180)), 0, 360, float(rng.uniform(60, 230)), -1)
    tiled = np.tile(motif, (height // cell + 1, width // cell + 1))[:height, :width]
    return tiled + 5 * fractal_noise(height, width, rng)


def poster(height: int, width: int, rng: np.random.Generator) -> Texture:
    """Paint a print: a photograph-like ground, shapes and letters in a frame."""
    image = 130 + 30 * fractal_noise(height, width, rng)
    short = min(height, width)
    for _ in range(14):
        centre = (int(rng.integers(0, width)), int(rng.integers(0, height)))
        tone, radius = float(rng.uniform(20, 235)), int(rng.integers(short // 30 + 2, short // 6 + 3))
        if rng.random() < 0.5:
            cv2.circle(image, centre, radius, tone, -1)
        else:
            box = cv2.boxPoints((centre, (radius * 2.0, radius * 1.2), float(rng.uniform(0, 180))))
            cv2.fillPoly(image, [box.astype(np.int32)], tone)
    for _ in range(5):
        _write_word(image, max(1, short // 70), rng)
    cv2.rectangle(image, (0, 0), (width - 1, height - 1), 40.0, max(2, short // 40))
    return np.clip(image, 5, 250)


def _write_word(image: Texture, pen: int, rng: np.random.Generator) -> None:
    """Draw a word of made-up letters: fonts differ between versions of OpenCV, these do not."""
    letters = [np.pad(rng.random(_GLYPH) < 0.5, ((0, 0), (0, 1))) for _ in range(6)]
    word = np.kron(np.hstack(letters), np.ones((pen, pen), bool))
    top, left = rng.integers(0, np.maximum(1, np.array(image.shape) - word.shape))
    place = image[top : top + word.shape[0], left : left + word.shape[1]]
    place[word[: place.shape[0], : place.shape[1]]] = rng.uniform(0, 255)


def shelf(height: int, width: int, rng: np.random.Generator) -> Texture:
    """Paint rows of book spines."""
    image = np.full((height, width), 60, np.float32)
    row = max(24, height // 4)
    for top in range(0, height, row):
        left = 0
        while left < width:
            thick, tall = int(rng.integers(6, 18)), int(rng.integers(row * 2 // 3, row - 3))
            bottom = top + row - 3
            cv2.rectangle(image, (left, bottom - tall), (left + thick - 2, bottom), float(rng.uniform(40, 220)), -1)
            label = (left + 1, bottom - int(rng.integers(tall // 3, tall)))
            cv2.rectangle(image, label, (left + thick - 3, label[1] + 6), float(rng.uniform(20, 240)), -1)
            left += thick
    return image + 6 * fractal_noise(height, width, rng)


def carton(height: int, width: int, rng: np.random.Generator) -> Texture:
    """Paint cardboard with tape and a label."""
    image = 140 + 9 * fractal_noise(height, width, rng)
    middle = width // 2
    cv2.rectangle(image, (middle - 6, 0), (middle + 6, height), 175.0, -1)
    tall, wide = max(12, height // 3), max(16, width // 3)
    top, left = int(rng.integers(0, height - tall)), int(rng.integers(0, width - wide))
    image[top : top + tall, left : left + wide] = poster(tall, wide, rng)
    return image + 4 * fractal_noise(height, width, rng, 3)
