"""Move a camera through the synthetic room as a hand would."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from types import MappingProxyType
from typing import Literal

import numpy as np
from scipy.spatial.transform import Rotation

from gtf_tune.sequence.render.scene import FloatArray

Motion = Literal["arc", "forward", "turn"]
Walk = Callable[[float], tuple[FloatArray, FloatArray]]
"""Position and target of the camera at a progress in [0, 1], in metres."""

_UP = np.array((0.0, 0.0, 1.0))


def _arc(progress: float) -> tuple[FloatArray, FloatArray]:
    position = np.array((1.4 + 3.0 * progress, 1.3 - 0.5 * np.sin(np.pi * progress), 1.45))
    return position, np.array((0.6 + 4.6 * progress, 4.2, 0.95))


def _forward(progress: float) -> tuple[FloatArray, FloatArray]:
    position = np.array((2.4 + 0.6 * progress, 0.5 + 1.9 * progress, 1.5))
    return position, position + np.array((0.3 * progress, 2.0, -0.25))


def _turn(progress: float) -> tuple[FloatArray, FloatArray]:
    angle = np.deg2rad(150 - 100 * progress)
    ahead = np.array((np.cos(angle), np.sin(angle), 0.0))
    position = np.array((3.0, 1.6, 1.45)) + 0.7 * ahead
    return position, position + ahead + np.array((0.0, 0.0, -0.2))


WALKS: Mapping[Motion, Walk] = MappingProxyType({"arc": _arc, "forward": _forward, "turn": _turn})
"""An arc past the furniture, a walk towards the back wall, and a turn on a small circle."""


@dataclass(frozen=True, eq=False)
class HandHeldPath:
    """Smooth path: a walk through the room with the sway and shake of a walking person.

    ``phases`` are the random phases of the sway, of shape (6, 2): position x, y, z and rotation about x, y, z at two
    frequencies.
    """

    phases: FloatArray
    walk: Walk = _arc

    def pose(self, progress: float) -> FloatArray:
        """Return the 4x4 world_from_camera pose (x right, y down, z forward) at a progress in [0, 1]."""
        sway = self._sway(progress)
        position, target = self.walk(progress)
        position = position + sway[:3]
        forward = (target - position) / np.linalg.norm(target - position)
        right = np.cross(forward, _UP)
        right /= np.linalg.norm(right)
        pose = np.eye(4)
        pose[:3, :3] = np.column_stack([right, np.cross(forward, right), forward])
        pose[:3, :3] = pose[:3, :3] @ Rotation.from_rotvec(sway[3:]).as_matrix()
        pose[:3, 3] = position
        return pose

    def _sway(self, progress: float) -> FloatArray:
        amplitude = np.array((0.12, 0.12, 0.08, 0.05, 0.05, 0.04))
        waves = np.sin(2 * np.pi * progress * np.array((2.3, 5.7)) + self.phases)
        return np.asarray(amplitude * (waves @ np.array((0.7, 0.3))))


def random_path(rng: np.random.Generator, motion: Motion = "arc") -> HandHeldPath:
    """Return a path of this motion with random sway."""
    return HandHeldPath(rng.uniform(0, 2 * np.pi, (6, 2)), WALKS[motion])
