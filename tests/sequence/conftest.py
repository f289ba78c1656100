"""Provide small images to the sequence tests."""

from collections.abc import Callable
from pathlib import Path

import cv2
import numpy as np
import pytest

WIDTH, HEIGHT = 64, 48


def picture(number: int, width: int = WIDTH, height: int = HEIGHT) -> np.ndarray:
    """Return a colour image of random blocks that differs from number to number."""
    blocks = np.random.default_rng(number).integers(0, 255, (6, 8, 3), dtype=np.uint8)
    return cv2.resize(blocks, (width, height), interpolation=cv2.INTER_NEAREST)


@pytest.fixture
def write_images() -> Callable[..., list[Path]]:
    """Return a function that writes numbered pictures into a folder under the given names."""

    def write(folder: Path, names: list[str], width: int = WIDTH, height: int = HEIGHT) -> list[Path]:
        paths = [folder / name for name in names]
        for number, path in enumerate(paths):
            path.parent.mkdir(parents=True, exist_ok=True)
            cv2.imwrite(str(path), picture(number, width, height))
        return paths

    return write
