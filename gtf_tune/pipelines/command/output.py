"""Read the trajectory that a program wrote, and find the frames that its poses belong to."""

from collections.abc import Callable, Mapping
from pathlib import Path, PurePosixPath
from types import MappingProxyType

import numpy as np

from gtf_tune.errors import RunError, TrajectoryError
from gtf_tune.pipelines.base import PipelineJob
from gtf_tune.pipelines.command.definition import OutputDefinition
from gtf_tune.trajectory import FloatArray, IntArray, Trajectory, associate_by_timestamp, read_trajectory
from gtf_tune.trajectory.formats import TextLayout, read_euroc, read_kitti, read_tum
from gtf_tune.trajectory.reconstructions import read_reconstruction

_READERS: Mapping[str, Callable[[Path, TextLayout], Trajectory]] = MappingProxyType(
    {"tum": read_tum, "kitti": read_kitti, "euroc": read_euroc}
)
_WHOLE = 0.05
_MODEL_FILES = ("images.bin", "images.txt")


def read_output(
    output: OutputDefinition, path: Path, names: tuple[str, ...], job: PipelineJob
) -> tuple[Trajectory, int]:
    """Read the trajectory at a path.

    Returns
    -------
    trajectory, repeated
        The poses with the frame ids, times and image names of the job's frames, and how many more were left out because
        another pose belongs to the same image.

    Raises
    ------
    RunError
        There is none, it is unusable, or a pose belongs to no frame.
    """
    if not path.exists():
        raise RunError(f"the program ended well but wrote no trajectory; it should be {path.name}")
    try:
        written = _read(output, path)
        found = written.select(_counted(written.timestamps, output))
        positions = _ASSOCIATIONS[output.association](found, names, job, output)
        kept = _counted(positions, output)
        trajectory = _of_frames(found.select(kept), positions[kept], output, job)
        return trajectory, len(written) - len(trajectory)
    except TrajectoryError as error:
        # Its folder is gone after the run, and has another name in each.
        reason = str(error).replace(str(path), output.path)
        raise RunError(f"the program's trajectory cannot be used: {reason}") from error


def _read(output: OutputDefinition, path: Path) -> Trajectory:
    scaled = output.time_scale != 1.0
    layout = TextLayout(
        output.delimiter.strip() or None,
        output.time_scale if scaled else None,
        output.sort,
        output.duplicates != "error",
    )
    if output.format == "colmap":
        return _largest_model(path)
    if output.format not in _READERS:
        return read_reconstruction(path, output.format)
    return _READERS[output.format](path, layout)


def _counted(places: FloatArray | IntArray, output: OutputDefinition) -> IntArray:
    """Return the rows that count, in their order, where several may have the same time or image."""
    if output.duplicates == "error":
        return np.arange(len(places))
    if output.duplicates == "first":
        rows = np.unique(places, return_index=True)[1]
    else:
        rows = len(places) - 1 - np.unique(places[::-1], return_index=True)[1]
    return np.sort(rows)


def _largest_model(path: Path) -> Trajectory:
    """Return the model in a folder, or the one with most images among those in its folders."""
    folders = [path, *sorted(place for place in path.iterdir() if place.is_dir())] if path.is_dir() else [path]
    models = [place for place in folders if place.is_file() or any((place / name).exists() for name in _MODEL_FILES)]
    if not models:
        raise TrajectoryError("expected a COLMAP model, but the program found none")
    return max((read_trajectory(model, "colmap") for model in models), key=len)


def _by_name(found: Trajectory, names: tuple[str, ...], job: PipelineJob, output: OutputDefinition) -> IntArray:
    del job, output
    known = {name: position for position, name in enumerate(names)}
    strange = [name for name in found.names if PurePosixPath(name).name not in known]
    if strange:
        raise TrajectoryError(f"it has the image '{strange[0]}', which the program was not given")
    return np.array([known[PurePosixPath(name).name] for name in found.names], dtype=np.int64)


def _by_timestamp(found: Trajectory, names: tuple[str, ...], job: PipelineJob, output: OutputDefinition) -> IntArray:
    del names
    frames = job.images.sequence.frames
    given = Trajectory(
        frame_ids=np.arange(len(frames)),
        timestamps=np.array([frame.timestamp for frame in frames]),
        positions=np.zeros((len(frames), 3)),
        quaternions=np.tile([0.0, 0.0, 0.0, 1.0], (len(frames), 1)),
    )
    positions, matched = associate_by_timestamp(given, found, output.max_difference_s)
    if len(matched) < len(found):
        strange = np.setdiff1d(np.arange(len(found)), matched)
        raise TrajectoryError(
            f"{len(strange)} of its {len(found)} poses belong to no image within {output.max_difference_s:g} s, "
            f"the first at {found.timestamps[strange[0]]:.6f} s; see 'time_scale' and 'max_difference_s'"
        )
    return positions


def _by_index(found: Trajectory, names: tuple[str, ...], job: PipelineJob, output: OutputDefinition) -> IntArray:
    del job, output
    positions: IntArray = np.rint(found.timestamps).astype(np.int64)
    strange = (np.abs(found.timestamps - positions) > _WHOLE) | (positions < 0) | (positions >= len(names))
    if strange.any():
        first = found.timestamps[strange.argmax()]
        raise TrajectoryError(f"its time {first:g} is no position in the list of {len(names)} images; see 'time_scale'")
    return positions


def _by_row(found: Trajectory, names: tuple[str, ...], job: PipelineJob, output: OutputDefinition) -> IntArray:
    del job, output
    if len(found) != len(names):
        raise TrajectoryError(
            f"it has {len(found)} poses for {len(names)} images, so rows do not say which image they are of"
        )
    return np.arange(len(found), dtype=np.int64)


_ASSOCIATIONS: Mapping[str, Callable[[Trajectory, tuple[str, ...], PipelineJob, OutputDefinition], IntArray]] = (
    MappingProxyType({"name": _by_name, "timestamp": _by_timestamp, "index": _by_index, "row": _by_row})
)


def _of_frames(found: Trajectory, positions: IntArray, output: OutputDefinition, job: PipelineJob) -> Trajectory:
    order = np.argsort(positions, kind="stable")
    if (np.diff(positions[order]) == 0).any():
        raise TrajectoryError("two of its poses belong to one image; see 'duplicates'")
    frames = [job.images.sequence.frames[position] for position in positions[order].tolist()]
    centres, rotations = found.positions[order], found.rotations[order.tolist()]
    if output.poses == "camera_from_world":
        rotations = rotations.inv()
        centres = -rotations.apply(centres.copy())
    written = job.images.names
    return Trajectory(
        frame_ids=np.array([frame.frame_id for frame in frames], dtype=np.int64),
        timestamps=np.array([frame.timestamp for frame in frames]),
        positions=centres,
        quaternions=rotations.as_quat() if output.poses == "camera_from_world" else found.quaternions[order],
        names=tuple(written[position] for position in positions[order].tolist()),
    )
