"""The trajectories of one configuration, as stored and aligned to each other."""

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from gtf_tune.errors import TrajectoryError
from gtf_tune.pipelines.run import RunKind
from gtf_tune.report.study_data import StudyData
from gtf_tune.store.database import Database
from gtf_tune.study.runs.run_source import stored_by_sequence
from gtf_tune.trajectory import FloatArray, IntArray, Trajectory, associate_by_frame_id
from gtf_tune.trajectory.alignment import AlignmentKind, umeyama


@dataclass(frozen=True, eq=False)
class ConfigurationRuns:
    """Trajectories of one configuration on one sequence; those of failed runs are empty."""

    title: str
    clean: tuple[Trajectory, ...]
    noisy: tuple[Trajectory, ...]
    num_frames: int
    alignment: AlignmentKind = "sim3"

    @property
    def reference(self) -> Trajectory | None:
        """The first clean run that has poses, to which the others are aligned; None where there is none."""
        return next((run for run in self.clean if len(run)), None)


def read_configuration(database: Database, data: StudyData, title: str, number: int) -> dict[str, ConfigurationRuns]:
    """Return the runs of one trial by sequence, under the given title; sequences without runs are absent.

    Raises
    ------
    StorageError
        A trajectory is not the one that was stored.
    """
    found = stored_by_sequence(database, [use for use in data.runs if use.number == number])
    return {
        name: ConfigurationRuns(title, runs.clean, runs.noisy, runs.num_frames, data.definition.gtf.alignment)
        for name, runs in ((sequence.name, found.get(sequence.name)) for sequence in data.sequences)
        if runs is not None
    }


PER_MILLE = 1000.0


@dataclass(frozen=True, eq=False)
class AlignedRun:
    """One run, aligned to the first clean run of its configuration.

    ``positions`` are (n, 3) in units of the extent, along the axes of largest to smallest motion. ``errors`` (n,) are
    in per mille of the extent: the distance from the clean runs for a noisy run, and from the other clean runs for a
    clean one; NaN where there is none to compare with.
    """

    kind: RunKind
    index: int
    frame_ids: IntArray
    positions: FloatArray
    errors: FloatArray

    def thinned(self, count: int) -> "AlignedRun":
        """Return at most ``count`` evenly spread poses, the first and the last among them."""
        if len(self.frame_ids) <= count:
            return self
        kept = np.unique(np.linspace(0, len(self.frame_ids) - 1, count).round().astype(np.int64))
        return AlignedRun(self.kind, self.index, self.frame_ids[kept], self.positions[kept], self.errors[kept])


def align_runs(runs: ConfigurationRuns) -> tuple[AlignedRun, ...]:
    """Return every run that can be aligned to the first usable clean run; empty where no clean run has poses."""
    reference = runs.reference
    if reference is None:
        return ()
    view = _View.of(reference)
    aligned: list[AlignedRun] = []
    for kind, run, index in _each(runs):
        others = [other for other in runs.clean if other is not run]
        try:
            positions = _aligned(reference, run, runs.alignment)
        except TrajectoryError:
            continue
        errors = _rms(frame_distances(others, [run], run.frame_ids, runs.alignment)[:, 0])
        aligned.append(AlignedRun(kind, index, run.frame_ids, view.seen(positions), PER_MILLE * errors / view.extent))
    return tuple(aligned)


def in_one_frame(configurations: Sequence[ConfigurationRuns]) -> tuple[ConfigurationRuns, ...]:
    """Return the configurations in the world frame of the first, so that their drawings can be compared."""
    target = configurations[0].reference if configurations else None
    return tuple(runs if target is None else _moved(runs, target) for runs in configurations)


def known_errors(runs: Sequence[AlignedRun]) -> FloatArray:
    """Return all known errors of all runs, (n,) in per mille of the extent."""
    known = [run.errors[np.isfinite(run.errors)] for run in runs]
    return np.concatenate(known) if known else np.empty(0)


def extent(trajectory: Trajectory) -> float:
    """Return the RMS distance of the positions from their mean, in the unit of the trajectory."""
    centred = trajectory.positions - trajectory.positions.mean(axis=0)
    return float(np.sqrt((centred**2).sum(axis=1).mean()))


def frame_distances(
    clean: Sequence[Trajectory], noisy: Sequence[Trajectory], frame_ids: IntArray, kind: AlignmentKind
) -> FloatArray:
    """Return (k, k_delta, n) distances at the given frames in the unit of the clean runs; NaN where there is none."""
    found = np.full((len(clean), len(noisy), len(frame_ids)), np.nan)
    for i, target in enumerate(clean):
        for j, run in enumerate(noisy):
            here, there = associate_by_frame_id(target, run)
            try:
                similarity = umeyama(run.positions[there], target.positions[here], kind)
            except TrajectoryError:
                continue
            moved = similarity.apply(run.positions[there]) - target.positions[here]
            columns = np.searchsorted(frame_ids, target.frame_ids[here])
            found[i, j, columns] = np.linalg.norm(moved, axis=1)
    return found


@dataclass(frozen=True, eq=False)
class _View:
    """View along the direction in which the camera moved least, in units of the extent."""

    origin: FloatArray
    axes: FloatArray
    extent: float

    @classmethod
    def of(cls, reference: Trajectory) -> "_View":
        origin = reference.positions.mean(axis=0)
        axes = np.linalg.svd(reference.positions - origin, full_matrices=True)[2]
        # Turned into a rotation, so that a scene is never seen in a mirror.
        axes[2] *= np.sign(np.linalg.det(axes)) or 1.0
        return cls(origin, axes, extent(reference) or math.nan)

    def seen(self, positions: FloatArray) -> FloatArray:
        seen: FloatArray = (positions - self.origin) @ self.axes.T / self.extent
        return seen


def _each(runs: ConfigurationRuns) -> list[tuple[RunKind, Trajectory, int]]:
    clean: list[tuple[RunKind, Trajectory, int]] = [("clean", run, index) for index, run in enumerate(runs.clean)]
    return [*clean, *(("noisy", run, index) for index, run in enumerate(runs.noisy))]


def _aligned(target: Trajectory, run: Trajectory, kind: AlignmentKind) -> FloatArray:
    if run is target:
        return run.positions
    here, there = associate_by_frame_id(target, run)
    return umeyama(run.positions[there], target.positions[here], kind).apply(run.positions)


def _moved(runs: ConfigurationRuns, target: Trajectory) -> ConfigurationRuns:
    reference = runs.reference
    if reference is None or reference is target:
        return runs
    here, there = associate_by_frame_id(target, reference)
    try:
        similarity = umeyama(reference.positions[there], target.positions[here], "sim3")
    except TrajectoryError:
        return runs
    clean, noisy = ([similarity.apply_to(run) for run in group] for group in (runs.clean, runs.noisy))
    return ConfigurationRuns(runs.title, tuple(clean), tuple(noisy), runs.num_frames, runs.alignment)


def _rms(distances: FloatArray) -> FloatArray:
    """Return the root mean square over the first axis of (m, n), leaving out NaN; NaN where nothing is left."""
    known = np.isfinite(distances)
    counts = known.sum(axis=0)
    squares = np.where(known, distances, 0.0) ** 2
    return np.where(counts > 0, np.sqrt(squares.sum(axis=0) / np.maximum(counts, 1)), np.nan)
