"""The poses of one camera, checked once."""

from collections.abc import Iterable
from dataclasses import dataclass, replace
from typing import Self

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.spatial.transform import Rotation

from gtf_tune.errors import TrajectoryError

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int64]
BoolArray = NDArray[np.bool_]

# Dividing by the norm leaves it within 2 eps of 1; leaving such quaternions alone makes normalising idempotent, so that
# storing and reading a trajectory returns the same bits.
_UNIT_NORM_TOLERANCE = 8 * np.finfo(np.float64).eps


@dataclass(frozen=True, eq=False)
class Trajectory:
    """Poses of one camera at the frames where they are known.

    Attributes
    ----------
    frame_ids
        (n,) strictly increasing int64: position of each frame in the full sequence. Poses of two trajectories with the
        same frame id belong together, unless ``ids_are_counted``.
    timestamps
        (n,) seconds; the frame ids where ``has_timestamps`` is false.
    positions
        (n, 3) camera centres in the world frame, in the trajectory's own unit.
    quaternions
        (n, 4) unit quaternions x, y, z, w: rotations world_from_camera.
    names
        n image names where the source has them, otherwise empty.
    ids_are_counted
        Whether the frame ids only number the poses of a file from 0, as for TUM, KITTI and EuRoC files: then they do
        not say which frame a pose belongs to. Matching such ids is refused unless both trajectories have the same
        ones (`check_frame_ids`); associate by timestamp or image name instead.
    has_timestamps
        Whether the source knows when each pose was taken; KITTI files and most COLMAP models do not.
    source
        The file or folder that the trajectory was read from, otherwise empty; only shown in messages.

    The arrays are read-only copies in float64 and int64 (scipy's ``Rotation.apply`` insists on writable ones: hand it a
    ``.copy()``); quaternions are normalised.

    Raises
    ------
    TrajectoryError
        A shape does not fit, a number is not finite, a quaternion has no length, or frame ids are not increasing.
    """

    frame_ids: IntArray
    timestamps: FloatArray
    positions: FloatArray
    quaternions: FloatArray
    names: tuple[str, ...] = ()
    ids_are_counted: bool = False
    has_timestamps: bool = True
    source: str = ""

    def __post_init__(self) -> None:
        count = len(self.frame_ids)
        _set(self, "frame_ids", _checked_ids(self.frame_ids))
        _set(self, "timestamps", _checked("timestamps", self.timestamps, (count,)))
        _set(self, "positions", _checked("positions", self.positions, (count, 3)))
        _set(self, "quaternions", _normalised(_checked("quaternions", self.quaternions, (count, 4))))
        object.__setattr__(self, "names", _checked_names(self.names, count))

    @classmethod
    def empty(cls) -> Self:
        """Return the trajectory without poses."""
        return cls(np.empty(0, np.int64), np.empty(0), np.empty((0, 3)), np.empty((0, 4)))

    def __len__(self) -> int:
        return len(self.frame_ids)

    @property
    def rotations(self) -> Rotation:
        """Return the n rotations world_from_camera."""
        return Rotation.from_quat(self.quaternions)

    def select(self, which: BoolArray | IntArray) -> Self:
        """Return the poses at a mask of shape (n,) or at strictly increasing indices."""
        indices = np.arange(len(self))[which]
        return replace(
            self,
            frame_ids=self.frame_ids[indices],
            timestamps=self.timestamps[indices],
            positions=self.positions[indices],
            quaternions=self.quaternions[indices],
            names=tuple(self.names[index] for index in indices) if self.names else (),
        )

    def with_frame_ids(self, frame_ids: IntArray) -> Self:
        """Return the same poses under the ids of the frames that they belong to, (n,) and strictly increasing."""
        return replace(self, frame_ids=frame_ids, ids_are_counted=False)

    def transformed(self, scale: float, rotation: FloatArray, translation: FloatArray) -> Self:
        """Return the trajectory in another world frame: positions become ``scale * rotation @ position + translation``.

        ``rotation`` is a (3, 3) matrix and turns the camera orientations too; ``translation`` is (3,).
        """
        return replace(
            self,
            positions=scale * self.positions @ rotation.T + translation,
            quaternions=(Rotation.from_matrix(rotation) * self.rotations).as_quat() if len(self) else self.quaternions,
        )


def _set(trajectory: Trajectory, name: str, array: FloatArray | IntArray) -> None:
    array.setflags(write=False)
    object.__setattr__(trajectory, name, array)


def _checked_names(names: Iterable[str], count: int) -> tuple[str, ...]:
    checked = tuple(names)
    if checked and len(checked) != count:
        raise TrajectoryError(f"expected one name for each of {count} poses, not {len(checked)} names")
    if any("\0" in name for name in checked):
        raise TrajectoryError("expected image names without zero bytes; rename the images")
    return checked


def _checked_ids(frame_ids: ArrayLike) -> IntArray:
    ids = np.array(frame_ids)
    if ids.ndim != 1 or (ids.size and not np.issubdtype(ids.dtype, np.integer)):
        raise TrajectoryError(f"expected whole frame ids of shape (n,), not {ids.dtype} of shape {ids.shape}")
    ids = ids.astype(np.int64)
    late = np.flatnonzero(np.diff(ids) <= 0)
    if late.size:
        first = int(late[0])
        raise TrajectoryError(
            f"expected strictly increasing frame ids, but {ids[first + 1]} follows {ids[first]} at pose {first + 1}"
        )
    return ids


def _checked(name: str, values: ArrayLike, shape: tuple[int, ...]) -> FloatArray:
    array = np.array(values, dtype=np.float64)
    if array.shape != shape:
        raise TrajectoryError(f"expected {name} of shape {shape}, not {array.shape}")
    broken = np.flatnonzero(~np.isfinite(array).all(axis=tuple(range(1, array.ndim))))
    if broken.size:
        raise TrajectoryError(f"expected finite {name}, but pose {broken[0]} has {array[broken[0]].tolist()}")
    return array


def _normalised(quaternions: FloatArray) -> FloatArray:
    with np.errstate(over="ignore"):
        norms = np.linalg.norm(quaternions, axis=1)
    broken = np.flatnonzero(~((norms > 0) & np.isfinite(norms)))
    if broken.size:
        raise TrajectoryError(f"expected unit quaternions, but pose {broken[0]} has {quaternions[broken[0]].tolist()}")
    norms[np.abs(norms - 1) <= _UNIT_NORM_TOLERANCE] = 1.0
    unit: FloatArray = quaternions / norms[:, np.newaxis]
    return unit
