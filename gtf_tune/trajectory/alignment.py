"""Alignment of one trajectory with another by a similarity.

The method is Umeyama, "Least-squares estimation of transformation parameters between two point patterns", IEEE PAMI
13(4), 1991; equation numbers below are the paper's. One batched kernel serves single pairs and thousands of them.
"""

from dataclasses import dataclass
from typing import Literal, Self, get_args

import numpy as np

from gtf_tune.errors import TrajectoryError
from gtf_tune.trajectory import FloatArray, Trajectory

AlignmentKind = Literal["sim3", "se3", "none"]

ALIGNMENTS: tuple[AlignmentKind, ...] = get_args(AlignmentKind)

MIN_MATCHED = 4
"""Fewest matched frames that give an alignment; three points can be laid on any three with little error."""

COLLINEAR_TOLERANCE = 1e-5
"""Ratio of second to first singular value of centred positions up to which they are taken to lie on a line.

The rotation about a line is not observable. A straight line written to a text file with six digits has a ratio of about
1e-6, with float64 positions 1e-15; the straightest real drive at hand (51 frames of KITTI 06) has 2.5e-3.
"""


COMPARABLE_SIZE = 1e100
"""How many times larger the source may be where its scale is not fitted; squares of more would overflow."""

INCOMPARABLE = (
    "expected trajectories of comparable size, but the second is over 1e100 times larger; look for divergence"
)

_ROUNDING = 8 * float(np.finfo(np.float64).eps)


@dataclass(frozen=True, eq=False)
class Similarity:
    """The map ``x -> scale * rotation @ x + translation`` between two world frames.

    ``rotation`` is a (3, 3) rotation matrix; ``translation``, (3,), is in the unit of the target frame.
    """

    scale: float
    rotation: FloatArray
    translation: FloatArray

    @classmethod
    def identity(cls) -> Self:
        """Return the map that changes nothing."""
        return cls(1.0, np.eye(3), np.zeros(3))

    def apply(self, points: FloatArray) -> FloatArray:
        """Return points of shape (n, 3) in the target frame."""
        moved: FloatArray = self.scale * points @ self.rotation.T + self.translation
        return moved

    def apply_to(self, trajectory: Trajectory) -> Trajectory:
        """Return the trajectory in the target frame, positions and orientations."""
        return trajectory.transformed(self.scale, self.rotation, self.translation)

    def inverse(self) -> "Similarity":
        """Return the map back."""
        return Similarity(1 / self.scale, self.rotation.T, -(self.rotation.T @ self.translation) / self.scale)


@dataclass(frozen=True, eq=False)
class NormalPoints:
    """Points as columns (3, n) of a size near 1: point = origin + unit * column."""

    points: FloatArray
    origin: FloatArray
    unit: float


@dataclass(frozen=True, eq=False)
class Alignments:
    """p alignments, each mapping a source to its target.

    Attributes
    ----------
    scales, rotations, translations
        (p,), (p, 3, 3) and (p, 3): the maps as in `Similarity`; meaningless where there is a reason.
    counts
        (p,) matched frames.
    radii
        (p,) RMS distance of the matched target positions from their mean.
    mean_squares
        (p,) mean squared distance that is left. Summed over residuals, as the closed form (eq. 33) cancels below 1e-7.
    reasons
        p sentences why a pair cannot be aligned, empty where it can.
    """

    scales: FloatArray
    rotations: FloatArray
    translations: FloatArray
    counts: FloatArray
    radii: FloatArray
    mean_squares: FloatArray
    reasons: tuple[str, ...]


@dataclass(frozen=True, eq=False)
class _Centred:
    """Points as columns (p, 3, n) about their means (p, 3), 0 where they are not matched."""

    means: FloatArray
    columns: FloatArray


def umeyama(source: FloatArray, target: FloatArray, kind: AlignmentKind = "sim3") -> Similarity:
    """Return the similarity that minimises the sum of squared distances of ``apply(source)`` from the target.

    Parameters
    ----------
    source, target
        Matched points of shape (n, 3).
    kind
        ``sim3`` fits scale, rotation and translation, ``se3`` rotation and translation; ``none`` is the identity.

    Raises
    ------
    TrajectoryError
        There are fewer than 4 points, one is not finite, or the points of one side lie on a line.
    """
    if source.shape != target.shape or source.ndim != 2 or source.shape[1] != 3:
        raise TrajectoryError(f"expected matched points of shape (n, 3), not {source.shape} and {target.shape}")
    if not (np.isfinite(source).all() and np.isfinite(target).all()):
        raise TrajectoryError("expected finite points to align, but some are NaN or infinite; drop those poses")
    if len(source) < MIN_MATCHED:
        raise TrajectoryError(_too_few(len(source)))
    if kind == "none":
        return Similarity.identity()
    from_source, from_target = normalised(source), normalised(target)
    # SE(3) keeps the unit that both sides share, Sim(3) gives each its own.
    ratio = from_source.unit / from_target.unit if kind == "se3" else 1.0
    if ratio > COMPARABLE_SIZE:
        raise TrajectoryError(INCOMPARABLE)
    found = align_all(
        from_target.points[np.newaxis], ratio * from_source.points[np.newaxis], np.ones((1, len(source))), kind
    )
    if found.reasons[0]:
        raise TrajectoryError(found.reasons[0])
    scale = float(found.scales[0]) * (from_target.unit / from_source.unit if kind == "sim3" else 1.0)
    shift = from_target.origin + from_target.unit * found.translations[0]
    return Similarity(scale, found.rotations[0], shift - scale * found.rotations[0] @ from_source.origin)


def normalised(points: FloatArray) -> NormalPoints:
    """Return points of shape (n, 3) relative to the first one and to their own size.

    The unit is a power of two, so dividing by it is exact. Positions that differ by no more than their rounding get the
    size 0 they stand for.
    """
    origin = points[0] if len(points) else np.zeros(3)
    relative = points.T - origin[:, np.newaxis]
    spread = _largest(relative)
    if spread <= _ROUNDING * _largest(points):
        return NormalPoints(np.zeros((3, len(points))), origin, 1.0)
    unit = float(np.ldexp(1.0, int(np.frexp(spread)[1])))
    relative /= unit
    return NormalPoints(relative, origin, unit)


def _largest(values: FloatArray) -> float:
    return max(float(values.max(initial=0.0)), -float(values.min(initial=0.0)))


def align_all(target: FloatArray, source: FloatArray, weights: FloatArray, kind: AlignmentKind) -> Alignments:
    """Return p alignments at once.

    Parameters
    ----------
    target, source
        Points as columns, (p, 3, n), or (1, 3, n) where all pairs share them; sizes near 1 keep squares from over- and
        underflowing.
    weights
        (p, n): 1 where both points of a column are known and 0 elsewhere; columns of weight 0 must be finite.
    kind
        As in `umeyama`.
    """
    counts = weights.sum(axis=1)
    to, come = _centred(target, weights, counts), _centred(source, weights, counts)  # eq. 34, 35
    spreads = _products(to, to, counts), _products(come, come, counts)
    scales, rotations = np.ones(len(counts)), np.broadcast_to(np.eye(3), (len(counts), 3, 3))
    reasons = tuple(_too_few(int(count)) for count in counts)
    if kind != "none":
        rotations, stretches = _rotations(_products(to, come, counts))
        reasons = _reasons(counts, *spreads, stretches)
        if kind == "sim3":
            scales = _ratio(stretches.sum(axis=1), np.einsum("pcc->p", spreads[1]))  # eq. 42
    maps = scales[:, np.newaxis, np.newaxis] * rotations
    shifts = to.means - (maps @ come.means[:, :, np.newaxis])[:, :, 0]  # eq. 41
    translations = np.zeros_like(shifts) if kind == "none" else shifts
    residuals = maps @ come.columns
    np.subtract(to.columns, residuals, out=residuals)
    # The residuals of centred points sum to 0, so the squares of what the means are apart simply add.
    mean_squares = _mean_squares(residuals, counts) + ((shifts - translations) ** 2).sum(axis=1)
    radii = np.sqrt(np.einsum("pcc->p", spreads[0]))
    return Alignments(scales, rotations, translations, counts, radii, mean_squares, reasons)


def _centred(points: FloatArray, weights: FloatArray, counts: FloatArray) -> _Centred:
    complete = bool((counts == weights.shape[1]).all())
    if complete:
        weights, counts = weights[: len(points)], counts[: len(points)]
    means = (points @ weights[:, :, np.newaxis])[:, :, 0] / np.maximum(counts, 1)[:, np.newaxis]
    columns = points - means[:, :, np.newaxis]
    if not complete:
        columns *= weights[:, np.newaxis]
    return _Centred(means, columns)


def _rotations(covariances: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return the proper rotations (p, 3, 3) that fit best, and the singular values (p, 3), the last with its sign."""
    left, stretches, right = np.linalg.svd(covariances)
    stretches[:, 2] *= (mirrored := np.sign(np.linalg.det(left) * np.linalg.det(right)))  # eq. 43
    right[:, 2] *= mirrored[:, np.newaxis]
    return left @ right, stretches  # eq. 40


def _mean_squares(residuals: FloatArray, counts: FloatArray) -> FloatArray:
    squares: FloatArray = np.einsum("pcn,pcn->p", residuals, residuals)
    return squares / np.maximum(counts, 1)


def _products(left: _Centred, right: _Centred, counts: FloatArray) -> FloatArray:
    """Return the covariances (p, 3, 3) of matched columns, eq. 36 to 38."""
    # Not matmul: BLAS takes twice as long for the product of three rows with themselves.
    products: FloatArray = np.einsum("pin,pjn->pij", left.columns, right.columns)
    return products / np.maximum(counts, 1)[:, np.newaxis, np.newaxis]


def _ratio(numerator: FloatArray, denominator: FloatArray) -> FloatArray:
    return np.divide(numerator, denominator, out=np.zeros_like(numerator), where=denominator > 0)


def _reasons(
    counts: FloatArray, spread_target: FloatArray, spread_source: FloatArray, stretch: FloatArray
) -> tuple[str, ...]:
    """Return a sentence for each pair whose rotation is not unique, by tests relative to the size of the points."""
    target, source = np.linalg.eigvalsh(spread_target), np.linalg.eigvalsh(spread_source)
    flatness = [
        _ratio(np.sqrt(np.maximum(spread[:, 1], 0)), np.sqrt(np.maximum(spread[:, 2], 0)))
        for spread in (target, source)
    ]
    common = _ratio(stretch[:, 1], np.sqrt(np.maximum(target[:, 2] * source[:, 2], 0)))
    broken = (
        (counts < MIN_MATCHED) | (np.minimum(*flatness) <= COLLINEAR_TOLERANCE) | (common <= COLLINEAR_TOLERANCE**2)
    )
    reasons = [""] * len(counts)
    for pair in np.flatnonzero(broken):
        reasons[pair] = _too_few(int(counts[pair])) or _on_a_line(float(flatness[0][pair]), float(flatness[1][pair]))
    return tuple(reasons)


def _too_few(count: int) -> str:
    if count >= MIN_MATCHED:
        return ""
    return f"expected at least {MIN_MATCHED} matched frames to compare trajectories, not {count}"


def _on_a_line(target: float, source: float) -> str:
    sides = [name for name, ratio in (("first", target), ("second", source)) if ratio <= COLLINEAR_TOLERANCE]
    if not sides:
        return "expected related positions, but no rotation of one trajectory fits the other better than all others"
    return (
        f"expected matched positions that span a plane, but those of the {' and the '.join(sides)} trajectory lie on a "
        f"line or coincide (singular values in the ratio {min(target, source):.1e})"
    )
