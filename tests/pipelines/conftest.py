"""Small scenes that COLMAP can reconstruct in seconds."""

from collections.abc import Collection, Mapping
from pathlib import Path
from types import MappingProxyType

import cv2
import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from gtf_tune.sequence import Camera, Frame, Sequence, SequenceCamera
from gtf_tune.testing import FolderStages
from gtf_tune.trajectory import Trajectory

WIDTH, HEIGHT, FOCAL = 240, 180, 220.0
TEXELS = 512
NO_FOCALS: Mapping[int, float] = MappingProxyType({})

# Centre, half size and depth of upright rectangles, far to near.
RECTANGLES = (((0.0, 0.0), 6.0, 7.0), ((-1.4, 0.3), 0.9, 4.5), ((1.3, -0.4), 0.8, 3.8), ((0.1, 0.7), 0.5, 3.0))


def _texture(seed: int) -> NDArray[np.uint8]:
    """Return blotches of many sizes, as SIFT likes them."""
    generator = np.random.default_rng(seed)
    total = np.zeros((TEXELS, TEXELS))
    for cells in (16, 40, 96, 200):
        grid = generator.standard_normal((cells, cells)).astype(np.float32)
        total += cv2.resize(grid, (TEXELS, TEXELS), interpolation=cv2.INTER_CUBIC)
    return np.clip(128 + 42 * total, 0, 255).astype(np.uint8)


def _view(camera: NDArray[np.float64], rotation: NDArray[np.float64], centre: NDArray[np.float64]) -> NDArray[np.uint8]:
    """Draw the rectangles, far to near, as seen from a camera with rotation cam_from_world."""
    image = np.zeros((HEIGHT, WIDTH), np.uint8)
    for seed, ((x, y), half, depth) in enumerate(RECTANGLES):
        size = 2 * half / TEXELS
        texture_to_world = np.array([[size, 0, x - half], [0, size, y - half], [0, 0, depth]])
        texture_to_world -= np.outer(centre, [0, 0, 1])
        homography = camera @ rotation @ texture_to_world
        drawn = cv2.warpPerspective(_texture(seed), homography, (WIDTH, HEIGHT), flags=cv2.INTER_AREA)
        mask = cv2.warpPerspective(np.full((TEXELS, TEXELS), 255, np.uint8), homography, (WIDTH, HEIGHT))
        image[mask > 127] = drawn[mask > 127]
    return image


def make_scene(
    folder: Path, frames: int, focals: Mapping[int, float] = NO_FOCALS, turned: Collection[int] = ()
) -> Sequence:
    """Render images into a folder and return them as a sequence with known intrinsics and ground truth.

    ``focals`` are focal lengths in pixels of images other than `FOCAL`; ``turned`` images are upright.
    """
    steps = np.linspace(-1, 1, frames)
    centres = np.stack([1.2 * steps, 0.3 * np.cos(3 * steps), 0.4 * np.sin(2 * steps)], axis=1)
    turns = Rotation.from_euler("yx", np.stack([0.25 * steps, 0.05 * np.sin(4 * steps)], axis=1))
    found: list[Frame] = []
    cameras: list[SequenceCamera] = []
    for index, (centre, turn) in enumerate(zip(centres, turns, strict=True)):
        path, focal = folder / f"{index:03d}.png", focals.get(index, FOCAL)
        intrinsics = np.array([[focal, 0, (WIDTH - 1) / 2], [0, focal, (HEIGHT - 1) / 2], [0, 0, 1]])
        view = _view(intrinsics, turn.as_matrix(), centre)
        cv2.imwrite(str(path), np.rot90(view) if index in turned else view)
        camera = _camera(focal, *((HEIGHT, WIDTH) if index in turned else (WIDTH, HEIGHT)))
        if camera not in cameras:
            cameras.append(camera)
        found.append(Frame(3 * index, path, index / 10, cameras.index(camera)))
    truth = Trajectory(
        frame_ids=np.arange(0, 3 * frames, 3),
        timestamps=np.arange(frames) / 10,
        positions=centres,
        quaternions=turns.inv().as_quat(),
    )
    return Sequence("scene", folder, "folder", tuple(found), tuple(cameras), truth)


def _camera(focal: float, width: int, height: int) -> SequenceCamera:
    intrinsics = Camera("PINHOLE", width, height, (focal, focal, width / 2, height / 2))
    return SequenceCamera(width, height, (width, height), intrinsics)


@pytest.fixture(scope="session")
def kept_stages(tmp_path_factory: pytest.TempPathFactory) -> FolderStages:
    """Return stages that all tests share, so that few of them start from pixels."""
    return FolderStages(tmp_path_factory.mktemp("kept"))


@pytest.fixture(scope="session")
def scene(tmp_path_factory: pytest.TempPathFactory) -> Sequence:
    return make_scene(tmp_path_factory.mktemp("scene"), frames=9)
