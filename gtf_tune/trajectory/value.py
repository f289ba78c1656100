"""The poses of one camera, checked once."""

import hashlib
import struct
import zlib
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


_MAGIC = b"GTFT"
_VERSION = 1
_CHECKSUM_BYTES = 8
_PREFIX = struct.Struct(f"<4sB{_CHECKSUM_BYTES}s")
_SIZES = struct.Struct("<QQ")
_NUMBERS_PER_POSE = 9
_BYTES_PER_NUMBER = 8


def to_bytes(trajectory: Trajectory) -> bytes:
    """Return the trajectory as compressed, versioned, checksummed bytes; `from_bytes` returns the same bits.

    Raises
    ------
    TrajectoryError
        Its frame ids only count the poses of a file: nothing could be matched with it later.
    """
    if trajectory.ids_are_counted:
        raise TrajectoryError(
            f"expected the frame ids of {len(trajectory)} poses to store, but they are only numbered by their order; "
            "give the ids of their frames by with_frame_ids"
        )
    names = "".join(f"{name}\0" for name in trajectory.names).encode("utf-8", "surrogatepass")
    numbers = np.concatenate(
        [
            trajectory.frame_ids.astype("<i8").view("<f8"),
            trajectory.timestamps,
            trajectory.positions.ravel(),
            trajectory.quaternions.ravel(),
        ]
    ).astype("<f8", copy=False)
    planes = numbers.view(np.uint8).reshape(-1, _BYTES_PER_NUMBER).T.tobytes()
    body = _SIZES.pack(len(trajectory), len(names)) + zlib.compress(planes + names)
    return _PREFIX.pack(_MAGIC, _VERSION, _checksum(body)) + body


def from_bytes(data: bytes) -> Trajectory:
    """Return the trajectory that `to_bytes` turned into these bytes.

    Raises
    ------
    TrajectoryError
        The bytes are no stored trajectory, of a newer version, or damaged.
    """
    if len(data) < _PREFIX.size + _SIZES.size or data[: len(_MAGIC)] != _MAGIC:
        raise TrajectoryError(f"expected the bytes of a stored trajectory, not {len(data)} bytes of something else")
    _, version, checksum = _PREFIX.unpack_from(data)
    if version != _VERSION:
        raise TrajectoryError(f"expected a stored trajectory of version {_VERSION}, not {version}; update gtf-tune")
    body = data[_PREFIX.size :]
    if checksum != _checksum(body):
        raise TrajectoryError("expected an intact stored trajectory, but its checksum differs")
    return _decode(body)


def _decode(body: bytes) -> Trajectory:
    count, name_bytes = _SIZES.unpack_from(body)
    number_bytes = count * _NUMBERS_PER_POSE * _BYTES_PER_NUMBER
    try:
        # One byte more than announced: a longer stream then shows itself without being unpacked whole.
        content = zlib.decompressobj().decompress(body[_SIZES.size :], number_bytes + name_bytes + 1)
        if len(content) != number_bytes + name_bytes:
            raise TrajectoryError("expected a stored trajectory of the announced size")
        names = content[number_bytes:].decode("utf-8", "surrogatepass").split("\0")[:-1]
    except (zlib.error, ValueError, OverflowError) as error:
        raise TrajectoryError(f"expected an intact stored trajectory, not this one ({error})") from error
    return _assemble(np.frombuffer(content[:number_bytes], np.uint8), int(count), tuple(names))


def _assemble(planes: NDArray[np.uint8], count: int, names: tuple[str, ...]) -> Trajectory:
    numbers: FloatArray = np.ascontiguousarray(planes.reshape(_BYTES_PER_NUMBER, -1).T).view("<f8").reshape(-1)
    ids, timestamps, positions, quaternions = np.split(numbers, [count, 2 * count, 5 * count])
    return Trajectory(
        frame_ids=ids.view("<i8").astype(np.int64),
        timestamps=timestamps,
        positions=positions.reshape(count, 3),
        quaternions=quaternions.reshape(count, 4),
        names=names,
    )


def _checksum(body: bytes) -> bytes:
    return hashlib.sha256(body).digest()[:_CHECKSUM_BYTES]
