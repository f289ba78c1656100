"""Lay the runs of one setting on each other, and say how far each frame moves."""

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from gtf_tune.errors import TrajectoryError
from gtf_tune.gtf.random_effects import far_above_median
from gtf_tune.pipelines.run import RunKind
from gtf_tune.trajectory import BoolArray, FloatArray, IntArray, Trajectory, associate_by_frame_id
from gtf_tune.trajectory.alignment import AlignmentKind, umeyama

_PER_MILLE = 1000.0


@dataclass(frozen=True, eq=False)
class SettingRuns:
    """Hold the trajectories of one setting on one sequence; those of failed runs are empty."""

    title: str
    clean: tuple[Trajectory, ...]
    noisy: tuple[Trajectory, ...]
    num_frames: int
    alignment: AlignmentKind = "sim3"


@dataclass(frozen=True, eq=False)
class AlignedRun:
    """Hold one run laid on the first clean run of its setting.

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


@dataclass(frozen=True, eq=False)
class FrameSpread:
    """Hold how the n frames that any run of one setting registered move under noise.

    ``median`` (n,) is in per mille of the extent: over all pairs of a clean and a noisy run that both have the frame.
    ``registered`` (n,) is the share of all runs that have the frame, ``fragile`` (n,) marks frames far above the median
    of their sequence.
    """

    title: str
    frame_ids: IntArray
    median: FloatArray
    registered: FloatArray
    fragile: BoolArray


def align_runs(runs: SettingRuns) -> tuple[AlignedRun, ...]:
    """Return every run that can be laid on the first usable clean run; empty where no clean run has poses."""
    reference = next((one for one in runs.clean if len(one)), None)
    if reference is None:
        return ()
    view = _View.of(reference)
    placed: list[AlignedRun] = []
    for kind, run, index in _each(runs):
        others = [one for one in runs.clean if one is not run]
        try:
            positions = _laid_on(reference, run, runs.alignment)
        except TrajectoryError:
            continue
        errors = _rms(_distances(others, [run], run.frame_ids, runs.alignment)[:, 0])
        placed.append(AlignedRun(kind, index, run.frame_ids, view.seen(positions), _PER_MILLE * errors / view.extent))
    return tuple(placed)


def frame_spread(runs: SettingRuns) -> FrameSpread:
    """Return how far each frame moves between clean and noisy runs."""
    everyone = [*runs.clean, *runs.noisy]
    frame_ids = np.unique(np.concatenate([one.frame_ids for one in everyone])) if everyone else np.empty(0, np.int64)
    reference = next((one for one in runs.clean if len(one)), None)
    extent = _View.of(reference).extent if reference is not None else math.nan
    distances = _distances(runs.clean, runs.noisy, frame_ids, runs.alignment)
    pairs = len(runs.clean) * len(runs.noisy)  # given, as -1 cannot be worked out where no run has a frame
    median = _PER_MILLE * _median(distances.reshape(pairs, len(frame_ids))) / extent
    present = np.array([np.isin(frame_ids, one.frame_ids) for one in everyone], dtype=np.float64)
    registered = present.mean(axis=0) if everyone else np.empty(0)
    return FrameSpread(runs.title, frame_ids, median, registered, far_above_median(median))


def lay_on_each_other(settings: Sequence[SettingRuns]) -> tuple[SettingRuns, ...]:
    """Return the settings in the world frame of the first, so that their drawings can be compared."""
    target = next((one for one in settings[0].clean if len(one)), None) if settings else None
    return tuple(one if target is None else _moved(one, target) for one in settings)


def known_errors(runs: Sequence[AlignedRun]) -> FloatArray:
    """Return all known errors of all runs, (n,) in per mille of the extent."""
    known = [run.errors[np.isfinite(run.errors)] for run in runs]
    return np.concatenate(known) if known else np.empty(0)


@dataclass(frozen=True, eq=False)
class _View:
    """Look along the direction in which the camera moved least, in units of the extent."""

    origin: FloatArray
    axes: FloatArray
    extent: float

    @classmethod
    def of(cls, reference: Trajectory) -> "_View":
        origin = reference.positions.mean(axis=0)
        centred = reference.positions - origin
        axes = np.linalg.svd(centred, full_matrices=True)[2]
        # Turned into a rotation, so that a scene is never seen in a mirror.
        axes[2] *= np.sign(np.linalg.det(axes)) or 1.0
        extent = float(np.sqrt((centred**2).sum(axis=1).mean()))
        return cls(origin, axes, extent or math.nan)

    def seen(self, positions: FloatArray) -> FloatArray:
        seen: FloatArray = (positions - self.origin) @ self.axes.T / self.extent
        return seen


def _each(runs: SettingRuns) -> list[tuple[RunKind, Trajectory, int]]:
    clean: list[tuple[RunKind, Trajectory, int]] = [("clean", run, index) for index, run in enumerate(runs.clean)]
    return [*clean, *(("noisy", run, index) for index, run in enumerate(runs.noisy))]


def _laid_on(target: Trajectory, run: Trajectory, kind: AlignmentKind) -> FloatArray:
    if run is target:
        return run.positions
    here, there = associate_by_frame_id(target, run)
    return umeyama(run.positions[there], target.positions[here], kind).apply(run.positions)


def _moved(runs: SettingRuns, target: Trajectory) -> SettingRuns:
    reference = next((one for one in runs.clean if len(one)), None)
    if reference is None or reference is target:
        return runs
    here, there = associate_by_frame_id(target, reference)
    try:
        similarity = umeyama(reference.positions[there], target.positions[here], "sim3")
    except TrajectoryError:
        return runs
    clean, noisy = ([similarity.apply_to(one) for one in group] for group in (runs.clean, runs.noisy))
    return SettingRuns(runs.title, tuple(clean), tuple(noisy), runs.num_frames, runs.alignment)


def _distances(
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


def _rms(distances: FloatArray) -> FloatArray:
    """Return the root mean square over the first axis of (m, n), leaving out NaN; NaN where nothing is left."""
    known = np.isfinite(distances)
    counts = known.sum(axis=0)
    squares = np.where(known, distances, 0.0) ** 2
    return np.where(counts > 0, np.sqrt(squares.sum(axis=0) / np.maximum(counts, 1)), np.nan)


def _median(distances: FloatArray) -> FloatArray:
    """Return the median over the first axis of (m, n), leaving out NaN; NaN where nothing is left."""
    result = np.full(distances.shape[1], np.nan)
    known = np.isfinite(distances).any(axis=0)
    if known.any():
        result[known] = np.nanmedian(distances[:, known], axis=0)
    return result
