"""Trajectories as bytes, and back, without losing a bit.

Layout, little-endian: magic ``GTFT``, version (1 byte), SHA-256 of everything after it cut to 8 bytes, number of poses
(8 bytes), bytes of names (8 bytes), then a zlib stream of frame ids, timestamps, positions, quaternions and names, each
name ended by a zero byte. All first bytes of the numbers come first, then all second ones and so on: similar bytes side
by side are what makes numbers compressible.
"""

import hashlib
import struct
import zlib

import numpy as np
from numpy.typing import NDArray

from gtf_tune.errors import TrajectoryError
from gtf_tune.trajectory.value import FloatArray, Trajectory

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
