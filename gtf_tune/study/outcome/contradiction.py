"""Compare what two configurations reconstruct without noise: what moves less under noise must still be the same thing.

The score sees how a reconstruction varies, not what it is. One that dropped its points, stopped moving or took another
shape may vary little; a contradiction with nominal's is a veto.
"""

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from gtf_tune.metrics import AteSettings, pairwise_matrix
from gtf_tune.trajectory import FloatArray, Trajectory

LEAST_FRAMES = 0.95
LEAST_POINTS = 0.5
LEAST_TRACKS = 0.5
"""Shares of nominal's registered frames, points and images per point that another configuration must keep."""

MOST_PATH = 2.0
"""Factor by which the length of the path, measured by the extent, may differ from nominal's in either direction."""

LEAST_DIFFERENCE = 0.05
"""Part of the extent up to which two trajectories count as the same shape, whatever noise explains."""

_NOISE_FACTOR = 3.0
"""What noise explains of the distance between two trajectories: so often the sum of what each moves under noise."""


@dataclass(frozen=True, eq=False)
class CleanRun:
    """What one run without noise reconstructed.

    ``num_points`` and ``track_length`` (images per point) are NaN where the pipeline does not say.
    """

    trajectory: Trajectory
    num_points: float = math.nan
    track_length: float = math.nan

    @property
    def path_length(self) -> float:
        """Length of the path through all positions over the RMS distance of these from their mean; NaN without one."""
        positions = self.trajectory.positions
        extent = (
            float(np.sqrt(((positions - positions.mean(axis=0)) ** 2).sum(axis=1).mean())) if len(positions) else 0.0
        )
        length = float(np.linalg.norm(np.diff(positions, axis=0), axis=1).sum())
        return length / extent if extent > 0 else math.nan


def contradictions(nominal: Sequence[CleanRun], other: Sequence[CleanRun], explained: float) -> tuple[str, ...]:
    """Return how clean runs of a configuration contradict those of nominal, in words that follow its name.

    Parameters
    ----------
    nominal, other
        Runs that worked; where one list is empty there is nothing to compare.
    explained
        Sum of what the two configurations move under noise, as a fraction of the extent.
    """
    if not nominal or not other:
        return ()
    return tuple(_contradictions(nominal, other, max(LEAST_DIFFERENCE, _NOISE_FACTOR * explained)))


def _contradictions(nominal: Sequence[CleanRun], other: Sequence[CleanRun], allowed: float) -> Iterator[str]:
    frames = [_median([float(len(run.trajectory)) for run in runs]) for runs in (nominal, other)]
    if frames[1] < LEAST_FRAMES * frames[0]:
        yield f"registers {frames[1]:.0f} frames where nominal registers {frames[0]:.0f}"
    points = [_median([run.num_points for run in runs]) for runs in (nominal, other)]
    if points[1] < LEAST_POINTS * points[0]:
        yield f"keeps {points[1]:.0f} points where nominal has {points[0]:.0f}"
    tracks = [_median([run.track_length for run in runs]) for runs in (nominal, other)]
    if tracks[1] < LEAST_TRACKS * tracks[0]:
        yield f"sees a point in {tracks[1]:.1f} images where nominal does in {tracks[0]:.1f}"
    paths = [_median([run.path_length for run in runs]) for runs in (nominal, other)]
    if not 1 / MOST_PATH <= paths[1] / paths[0] <= MOST_PATH and not math.isnan(paths[0]):
        yield f"has a path of {paths[1]:.1f} times its extent where nominal's is {paths[0]:.1f} times"
    yield from _other_shape(nominal, other, allowed)


def _other_shape(nominal: Sequence[CleanRun], other: Sequence[CleanRun], allowed: float) -> Iterator[str]:
    """Yield that no run has the shape of one of nominal's, if so, by the smallest ATE of a pair."""
    pairs = pairwise_matrix([run.trajectory for run in nominal], [run.trajectory for run in other], AteSettings("sim3"))
    differences: FloatArray = (pairs.errors / pairs.extents)[~np.isnan(pairs.errors)]
    if not differences.size:
        yield f"gives a trajectory that cannot be compared with nominal's: {next(iter(pairs.reasons.values()))}"
    elif differences.min() > allowed:
        yield (
            f"gives a trajectory that is {1000 * differences.min():.0f} per mille of the extent from nominal's, more "
            f"than the {1000 * allowed:.0f} that noise explains"
        )


def _median(values: Sequence[float]) -> float:
    known = [value for value in values if not math.isnan(value)]
    return float(np.median(known)) if known else math.nan
