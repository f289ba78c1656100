"""Functions as pipelines, importable by the processes of runs."""

from collections.abc import Mapping
from typing import Any

import numpy as np

from gtf_tune.pipelines import Pipeline, analytic
from gtf_tune.pipelines.function import RunImages

NOMINAL = {"max_error": 0.01, "rounds": 3, "robust": True, "kernel": "huber"}


def circle(images: RunImages, options: Mapping[str, Any], seed: int) -> tuple[np.ndarray, np.ndarray]:
    """A circle whose errors grow with the noise of the images and with ``max_error``."""
    angles = images.frame_ids / 10
    noise = float(np.std(images.arrays[0])) + 0.1
    shaken = np.random.default_rng(seed).normal(scale=options["max_error"] * noise, size=(len(images), 3))
    positions = np.stack([np.cos(angles), np.sin(angles), 0.2 * np.sin(3 * angles)], axis=1) + shaken
    return positions, np.tile([0.0, 0.0, 0.0, 1.0], (len(images), 1))


def with_nominal(images: RunImages, options: Mapping[str, Any], seed: int) -> object:
    return circle(images, options, seed)


with_nominal.nominal = NOMINAL  # type: ignore[attr-defined]


def factory(settings: Mapping[str, object]) -> Pipeline:
    return analytic.create(settings)


PIPELINE = analytic.create({})
NUMBER = 3


def wrong_factory(settings: Mapping[str, object]) -> object:
    return dict(settings)
