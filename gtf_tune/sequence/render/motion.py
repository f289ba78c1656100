"""Move a camera through the synthetic room as a hand would."""

from dataclasses import dataclass

import numpy as np
from scipy.spatial.transform import Rotation

from gtf_tune.sequence.render.scene import FloatArray

_UP = np.array((0.0, 0.0, 1.0))


@dataclass(frozen=True, eq=False)
class HandHeldPath:
    """Smooth path: an arc through the room with the sway and shake of a walking person.

    ``phases`` are the random phases of the sway, of shape (6, 2): position x, y, z and rotation about x, y, z at two
    frequencies.
    """

    phases: FloatArray

    def pose(self, progress: float) -> FloatArray:
        """Return the 4x4 world_from_camera pose (x right, y down, z forward) at a progress in [0, 1]."""
        sway = self._sway(progress)
        position = np.array((1.4 + 3.0 * progress, 1.3 - 0.5 * np.sin(np.pi * progress), 1.45)) + sway[:3]
        target = np.array((0.6 + 4.6 * progress, 4.2, 0.95))
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


def random_path(rng: np.random.Generator) -> HandHeldPath:
    """Return a path with random sway."""
    return HandHeldPath(rng.uniform(0, 2 * np.pi, (6, 2)))
