"""Errors of one trajectory against another."""

import numpy as np

from gtf_tune.errors import TrajectoryError
from gtf_tune.metrics.pairwise import pairwise_matrix
from gtf_tune.metrics.relative import matched_paths, relative_errors
from gtf_tune.metrics.settings import AteSettings, MetricSettings, RpeSettings, check_word
from gtf_tune.trajectory import FloatArray, Trajectory, associate_by_frame_id
from gtf_tune.trajectory.alignment import ALIGNMENTS, AlignmentKind, Similarity, umeyama


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
