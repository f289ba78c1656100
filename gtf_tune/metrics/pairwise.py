"""Errors of many pairs of trajectories at once."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from gtf_tune.errors import TrajectoryError
from gtf_tune.metrics.relative import matched_paths, relative_errors
from gtf_tune.metrics.settings import AteSettings, MetricSettings, RpeSettings, check_word
from gtf_tune.metrics.statistics import rms
from gtf_tune.trajectory import (
    MAX_DIFFERENCE_S,
    Association,
    FloatArray,
    IntArray,
    Trajectory,
    associate,
    associate_by_frame_id,
    check_frame_ids,
    matched,
)
from gtf_tune.trajectory.alignment import (
    ALIGNMENTS,
    COMPARABLE_SIZE,
    INCOMPARABLE,
    AlignmentKind,
    Alignments,
    Similarity,
    align_all,
    normalised,
    umeyama,
)


@dataclass(frozen=True, eq=False)
class TrajectoryStack:
    """t trajectories over the same f frames.

    Attributes
    ----------
    points
        (t, 3, f): position = origin + unit * column; 0 where a trajectory lacks the frame.
    known
        (t, f): 1 where it has the frame, 0 elsewhere.
    origins, units
        (t, 3) and (t,).
    """

    points: FloatArray
    known: FloatArray
    origins: FloatArray
    units: FloatArray


@dataclass(frozen=True, eq=False)
class PairBlock:
    """One trajectory, the target, matched and aligned with each of p others, the sources.

    Attributes
    ----------
    alignments
        The maps from source to target columns.
    unit
        Lengths of target columns times this are lengths of the target.
    scales
        (p,): the same maps' scales between the trajectories themselves.
    reasons
        p sentences why a pair cannot be measured, empty where it can.
    """

    alignments: Alignments
    unit: float
    scales: FloatArray
    reasons: tuple[str, ...]

    @property
    def rmse(self) -> FloatArray:
        """Return the RMSE of positions after alignment, (p,), in the unit of the target."""
        return self.unit * np.sqrt(self.alignments.mean_squares)

    @property
    def extents(self) -> FloatArray:
        """Return the RMS distance of the matched target positions from their mean, (p,), in the unit of the target."""
        return self.unit * self.alignments.radii


def stack(trajectories: Sequence[Trajectory], frame_ids: IntArray) -> TrajectoryStack:
    """Return the trajectories over the given sorted frame ids, which hold all of theirs."""
    shape = (len(trajectories), len(frame_ids))
    points, known = np.zeros((shape[0], 3, shape[1])), np.zeros(shape)
    origins, units = np.zeros((shape[0], 3)), np.ones(shape[0])
    for row, trajectory in enumerate(trajectories):
        columns = _columns(trajectory, frame_ids)
        normal = normalised(trajectory.positions)
        points[row][:, columns], known[row, columns] = normal.points, 1.0
        origins[row], units[row] = normal.origin, normal.unit
    return TrajectoryStack(points, known, origins, units)


def _columns(trajectory: Trajectory, frame_ids: IntArray) -> slice | IntArray:
    if len(trajectory) == len(frame_ids):
        return slice(None)
    return np.searchsorted(frame_ids, trajectory.frame_ids).astype(np.int64)


def common_frames(*groups: Sequence[Trajectory]) -> IntArray:
    """Return the sorted frame ids that any of the trajectories has.

    Raises
    ------
    TrajectoryError
        Frame ids only count the poses of a file, and the trajectories have different ones.
    """
    check_frame_ids([trajectory for group in groups for trajectory in group])
    ids = [trajectory.frame_ids for group in groups for trajectory in group]
    if all(np.array_equal(other, ids[0]) for other in ids):
        return ids[0] if ids else np.empty(0, np.int64)
    return np.unique(np.concatenate(ids))


def align_block(a: TrajectoryStack, row: int, b: TrajectoryStack, rows: slice, kind: AlignmentKind) -> PairBlock:
    """Return trajectories ``rows`` of b aligned to trajectory ``row`` of a."""
    source, apart = b.points[rows], np.zeros(len(b.units[rows]), dtype=bool)
    if kind != "sim3":
        ratios = b.units[rows] / a.units[row]
        shifts = (b.origins[rows] - a.origins[row]) / a.units[row] if kind == "none" else np.zeros((len(ratios), 3))
        apart = np.maximum(ratios, np.abs(shifts).max(axis=1, initial=0.0)) > COMPARABLE_SIZE
        ratios[apart], shifts[apart] = 1.0, 0.0
        source = source * ratios[:, np.newaxis, np.newaxis] + shifts[:, :, np.newaxis]
    found = align_all(a.points[row : row + 1], source, a.known[row] * b.known[rows], kind)
    reasons = tuple(INCOMPARABLE if far else reason for far, reason in zip(apart, found.reasons, strict=True))
    scales = found.scales * (a.units[row] / b.units[rows] if kind == "sim3" else 1.0)
    return PairBlock(found, float(a.units[row]), scales, reasons)


PAPER_METRIC = AteSettings()

# Arrays of a block then stay in a core's cache; of 2,000 poses, 16 pairs at once are faster than 4 and than 60.
_BLOCK_COLUMNS = 32_768


@dataclass(frozen=True, eq=False)
class PairMatrix:
    """Errors of all pairs of two lists of trajectories.

    Attributes
    ----------
    errors
        (ka, kb): RMSE of each pair, in the unit of the first list's trajectory or in degrees; NaN where it failed.
    extents
        (ka, kb): RMS distance of the first trajectory's matched positions from their mean; NaN where the pair failed.
    matched
        (ka, kb): number of matched frames.
    reasons
        Why a pair failed, by its indices.
    """

    errors: FloatArray
    extents: FloatArray
    matched: IntArray
    reasons: dict[tuple[int, int], str]


def pairwise_matrix(
    a: Sequence[Trajectory], b: Sequence[Trajectory], settings: MetricSettings = PAPER_METRIC
) -> PairMatrix:
    """Return the error of every trajectory of b against every one of a, matched by frame id.

    Pairs with fewer than 4 matched frames, with positions on a line, or without poses that lie ``delta`` apart are NaN
    with a reason. The work is done in blocks of pairs; residuals are computed one by one, because the closed form of
    the error cancels below 1e-7 of the extent.

    Raises
    ------
    TrajectoryError
        Frame ids only count the poses of a file, and the trajectories have different ones.
    """
    frames = common_frames(a, b)
    stacks = stack(a, frames), stack(b, frames)
    shape = len(a), len(b)
    errors, extents, matched = np.full(shape, np.nan), np.full(shape, np.nan), np.zeros(shape, np.int64)
    reasons: dict[tuple[int, int], str] = {}
    for row, rows in _blocks(shape, len(frames)):
        block = align_block(stacks[0], row, stacks[1], rows, settings.alignment)
        rmse = block.rmse if isinstance(settings, AteSettings) else _relative_rmse(a[row], b[rows], block, settings)
        faults = _faults(block, rmse, settings)
        usable = np.array([not fault for fault in faults])
        matched[row, rows] = block.alignments.counts
        errors[row, rows] = np.where(usable, rmse, np.nan)
        extents[row, rows] = np.where(usable, block.extents, np.nan)
        reasons.update({(row, rows.start + index): fault for index, fault in enumerate(faults) if fault})
    return PairMatrix(errors, extents, matched, reasons)


def associated_matrix(
    a: Sequence[Trajectory],
    b: Sequence[Trajectory],
    association: Association,
    settings: MetricSettings = PAPER_METRIC,
    max_difference_s: float = MAX_DIFFERENCE_S,
) -> PairMatrix:
    """Return the error of every trajectory of b against every one of a, each pair associated on its own.

    This is `pairwise_matrix` for trajectories whose frame ids do not say which poses belong together; see
    `gtf_tune.trajectory.associate`.

    Raises
    ------
    TrajectoryError
        A pair cannot be associated.
    """
    pairs = [
        [pairwise_matrix(*_matched(first, second, association, max_difference_s), settings) for second in b]
        for first in a
    ]
    shape = len(a), len(b)
    return PairMatrix(
        errors=np.array([pair.errors for row in pairs for pair in row]).reshape(shape),
        extents=np.array([pair.extents for row in pairs for pair in row]).reshape(shape),
        matched=np.array([pair.matched for row in pairs for pair in row], dtype=np.int64).reshape(shape),
        reasons={
            (i, j): pair.reasons[0, 0] for i, row in enumerate(pairs) for j, pair in enumerate(row) if pair.reasons
        },
    )


def _matched(
    a: Trajectory, b: Trajectory, association: Association, max_difference_s: float
) -> tuple[list[Trajectory], list[Trajectory]]:
    first, second = matched(a, b, associate(a, b, association, max_difference_s))
    return [first], [second]


def _blocks(shape: tuple[int, int], frames: int) -> Iterator[tuple[int, slice]]:
    """Yield each row of the matrix with neighbouring columns of it."""
    size = max(1, _BLOCK_COLUMNS // max(frames, 1))
    for row in range(shape[0]):
        for start in range(0, shape[1], size):
            yield row, slice(start, min(start + size, shape[1]))


def _relative_rmse(a: Trajectory, b: Sequence[Trajectory], block: PairBlock, settings: RpeSettings) -> FloatArray:
    """Return the RMSE of the relative errors of each pair, NaN where there are none.

    The loop is over pairs, because which poses make a pair is found greedily; the poses are done at once.
    """
    scales = block.scales.tolist()
    paths = [matched_paths(a, source, scale, settings) for source, scale in zip(b, scales, strict=True)]
    errors = [relative_errors(*path, settings) for path in paths]
    return np.array([rms(values) if len(values) else np.nan for values in errors])


def _faults(block: PairBlock, rmse: FloatArray, settings: MetricSettings) -> tuple[str, ...]:
    """Return why each pair has no error, empty where it has one."""
    if isinstance(settings, AteSettings):
        return block.reasons
    missing = f"expected poses {settings.delta:g} {settings.delta_unit} apart, but there are none; take a smaller delta"
    empty = np.isnan(rmse).tolist()
    return tuple(reason or (missing if none else "") for reason, none in zip(block.reasons, empty, strict=True))


def ate(a: Trajectory, b: Trajectory, alignment: AlignmentKind = "sim3") -> float:
    """Return the absolute trajectory error of b against a, matched by frame id, in the unit of a.

    This is the RMSE over matched frames of ``|s R b + t - a|`` with the alignment that minimises it (Sturm et al., "A
    benchmark for the evaluation of RGB-D SLAM systems", IROS 2012).

    Raises
    ------
    TrajectoryError
        There are fewer than 4 matched frames, or positions lie on a line.
    """
    return _only_pair(a, b, AteSettings(alignment))


def rpe(a: Trajectory, b: Trajectory, settings: RpeSettings) -> float:
    """Return the relative pose error of b against a, matched by frame id, in the unit of a or in degrees.

    This is the RMSE over the pairs of poses that the settings choose.

    Raises
    ------
    TrajectoryError
        There are fewer than 4 matched frames, positions lie on a line, or no poses lie ``delta`` apart.
    """
    return _only_pair(a, b, settings)


def align(a: Trajectory, b: Trajectory, alignment: AlignmentKind = "sim3") -> Similarity:
    """Return the similarity that lays b on a, fitted to the positions of their matched frames.

    Raises
    ------
    TrajectoryError
        There are fewer than 4 matched frames, or positions lie on a line.
    """
    check_word("alignment", alignment, ALIGNMENTS)
    ia, ib = associate_by_frame_id(a, b)
    return umeyama(b.positions[ib], a.positions[ia], alignment)


def aligned_errors(a: Trajectory, b: Trajectory, alignment: AlignmentKind = "sim3") -> FloatArray:
    """Return the distance of aligned b from a at each matched frame, (m,) in the unit of a.

    Raises
    ------
    TrajectoryError
        There are fewer than 4 matched frames, or positions lie on a line.
    """
    ia, ib = associate_by_frame_id(a, b)
    gaps = align(a, b, alignment).apply(b.positions[ib]) - a.positions[ia]
    distances: FloatArray = np.linalg.norm(gaps, axis=1)
    return distances


def rpe_errors(a: Trajectory, b: Trajectory, settings: RpeSettings) -> FloatArray:
    """Return the error of each pair of poses of b against a, (m,) in the unit of a or in degrees.

    Raises
    ------
    TrajectoryError
        There are fewer than 4 matched frames, or positions lie on a line.
    """
    return relative_errors(*matched_paths(a, b, align(a, b, settings.alignment).scale, settings), settings)


def _only_pair(a: Trajectory, b: Trajectory, settings: MetricSettings) -> float:
    found = pairwise_matrix([a], [b], settings)
    if found.reasons:
        raise TrajectoryError(found.reasons[0, 0])
    return float(found.errors[0, 0])
