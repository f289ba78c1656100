"""Read and write the trajectories of runs, and notice when one is not what was stored."""

import hashlib
from collections.abc import Sequence

from sqlalchemy import select

from gtf_tune.errors import StorageError, TrajectoryError
from gtf_tune.store.database import Database, models
from gtf_tune.store.database.session import chunks, read_rows
from gtf_tune.trajectory import Trajectory, from_bytes


def digest_of(trajectory: Trajectory) -> str:
    """Return the hex SHA-256 of the numbers and names of a trajectory, whatever compression stores it."""
    total = hashlib.sha256()
    for numbers in (trajectory.timestamps, trajectory.positions, trajectory.quaternions):
        total.update(numbers.astype("<f8").tobytes())
    total.update(trajectory.frame_ids.astype("<i8").tobytes())
    total.update("\0".join(trajectory.names).encode("utf-8", "surrogatepass"))
    return total.hexdigest()


def trajectories(database: Database, keys: Sequence[str]) -> dict[str, Trajectory]:
    """Return the trajectory of each run that is stored under one of these keys; those of failed runs are empty.

    Raises
    ------
    StorageError
        A trajectory is not the one that was stored; the message names the run.
    """
    found: dict[str, Trajectory] = {}
    for some in chunks(keys):
        query = (
            select(models.Run.key, models.Run.trajectory_digest, models.RunOutput.trajectory)
            .join(models.RunOutput, models.RunOutput.run_id == models.Run.id)
            .where(models.Run.key.in_(some))
        )
        for key, digest, data in read_rows(database, query):
            found[key] = checked_trajectory(key, digest, data)
    return found


def checked_trajectory(key: str, digest: str, data: bytes) -> Trajectory:
    """Return the trajectory that these bytes hold, or raise `StorageError` where it is not the one that was stored."""
    damaged = f"the stored trajectory of run {key} is damaged"
    advice = "restore a backup, or delete the study and run it again"
    try:
        trajectory = from_bytes(data)
    except TrajectoryError as error:
        raise StorageError(f"{damaged} ({error}); {advice}") from error
    if digest_of(trajectory) != digest:
        raise StorageError(f"{damaged} (its digest differs); {advice}")
    return trajectory
