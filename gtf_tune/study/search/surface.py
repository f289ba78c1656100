"""Choose the next configuration of several options from noisy values at some tens of points.

Expected improvement under a Gaussian process with a Matern 5/2 kernel and one length for each option (Jones et al., J.
Global Optimization 13, 1998; Rasmussen and Williams, Gaussian Processes for Machine Learning, 2006, section 5.4.1), in
numpy and scipy. Options are placed in [0, 1]; those without an order are equal or a whole length apart.
"""

import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from scipy.linalg import cho_solve, cholesky, solve_triangular
from scipy.optimize import minimize

from gtf_tune.study.search.curve import expected_improvement
from gtf_tune.trajectory import BoolArray, FloatArray

_SQRT5 = math.sqrt(5.0)
_STARTS = (0.3, 1.0)
_LENGTHS = (0.05, 20.0)
_NOISES = (0.003, 1.0)
_USUAL_NOISE = 0.05
_NOISE_DOUBT = 1.0
_LENGTH_DOUBT = 1.0
_STEPS = 40
_SMALLEST = 1e-12
_SAME = 1e-9
_ROUNDS = (0.2, 0.07, 0.02)

Snap = Callable[[FloatArray], FloatArray]
"""Move points (m, d) to the nearest ones that options can take."""


@dataclass(frozen=True, eq=False)
class Surface:
    """Gaussian process fitted to values (n,) at points (n, d); ``unordered`` (d,) marks options without an order."""

    points: FloatArray
    unordered: BoolArray
    lengths: FloatArray
    weights: FloatArray
    factor: FloatArray
    variance: float
    centre: float

    def mean(self, points: FloatArray) -> FloatArray:
        """Return the expected values at points, (m,)."""
        return np.asarray(self.centre + self._kernel(points).T @ self.weights)

    def improvement(self, points: FloatArray, lowest: float) -> FloatArray:
        """Return by how much points (m, d) are expected to fall below ``lowest``, (m,)."""
        kernel = self._kernel(points)
        known = solve_triangular(self.factor, kernel, lower=True)
        deviation = np.sqrt(np.maximum(self.variance * (1.0 - (known**2).sum(axis=0)), _SMALLEST))
        return expected_improvement(lowest - self.centre - kernel.T @ self.weights, deviation)

    def _kernel(self, points: FloatArray) -> FloatArray:
        squares = _squares(self.points, points, self.unordered)
        return _matern(np.sqrt(squares @ self.lengths**-2.0))


def fit_surface(points: FloatArray, values: FloatArray, unordered: BoolArray) -> Surface:
    """Return the most likely surface through values (n,) at points (n, d), n >= 2; always the same for the same data.

    Lengths are expected to grow with the number of options (Hvarfner et al., ICML 2024): else every corner of a space
    of many options counts as unknown. Noise is relative to the standard deviation of the surface.
    """
    options, centre = points.shape[1], float(values.mean())
    likelihood = _Likelihood(_squares(points, points, unordered), values - centre)
    usual = math.sqrt(options / 2.0)
    bounds = [(math.log(low), math.log(high)) for low, high in [_LENGTHS] * options + [_NOISES]]
    fits = [
        minimize(
            likelihood.cost,
            np.log([start * usual] * options + [_USUAL_NOISE]),
            jac=True,
            method="L-BFGS-B",
            bounds=bounds,
            options={"maxiter": _STEPS},
        )
        for start in _STARTS
    ]
    found = min(fits, key=lambda fit: float(fit.fun)).x
    factor, weights, variance = likelihood.solve(found)[1:4]
    return Surface(points, unordered, np.exp(found[:-1]), weights, factor, variance, centre)


def next_point(surface: Surface, seed: int, snap: Snap, fewest: int = 1500) -> FloatArray:
    """Return the point (d,) from which the largest improvement on the lowest known part of the surface is expected.

    Points are drawn everywhere and around the best known ones, then ever closer around the best drawn ones. A known
    point comes last, however uncertain its value: running it again would give the same noise and the same score.
    """
    generator = np.random.default_rng(seed)
    known = surface.mean(surface.points)
    lowest = float(known.min())
    best = surface.points[np.argsort(known, kind="stable")[:5]]
    drawn = generator.random((fewest, best.shape[1]))
    points = snap(np.concatenate([drawn, *(_near(best, width, 60, generator) for width in _ROUNDS)]))
    for width in _ROUNDS:
        expected = _promise(surface, points, lowest)
        top = points[np.argsort(-expected, kind="stable")[:5]]
        points = np.concatenate([top, snap(_near(top, width, 60, generator))])
    return np.asarray(points[int(np.argmax(_promise(surface, points, lowest)))])


def _promise(surface: Surface, points: FloatArray, lowest: float) -> FloatArray:
    """Return the expected improvement at points (m, d), and -1 at those that are known."""
    known = np.any(np.all(np.abs(points[:, np.newaxis] - surface.points) <= _SAME, axis=2), axis=1)
    return np.where(known, -1.0, surface.improvement(points, lowest))


def _near(centres: FloatArray, width: float, count: int, generator: np.random.Generator) -> FloatArray:
    """Return points around each centre that differ from it in some of the options."""
    points = np.repeat(centres, count, axis=0)
    options = points.shape[1]
    moved = generator.random(points.shape) < max(0.5, 1.0 / options)
    moved[np.arange(len(points)), generator.integers(options, size=len(points))] = True
    anew = generator.random(points.shape) < 0.2
    steps = np.where(anew, generator.random(points.shape) - points, width * generator.standard_normal(points.shape))
    return np.asarray(np.clip(points + moved * steps, 0.0, 1.0))


@dataclass(frozen=True, eq=False)
class _Likelihood:
    """Negative log posterior of lengths and noise, given squared differences (n, n, d) and centred values (n,)."""

    squares: FloatArray
    values: FloatArray

    def solve(self, logs: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray, float]:
        """Return distances, Cholesky factor, weights, and the most likely variance."""
        distances = np.sqrt(self.squares @ np.exp(-2.0 * logs[:-1]))
        covariance = _matern(distances) + math.exp(2.0 * logs[-1]) * np.eye(len(self.values))
        factor = cholesky(covariance, lower=True)
        weights = cho_solve((factor, True), self.values)
        return distances, factor, weights, max(float(self.values @ weights) / len(self.values), _SMALLEST)

    def cost(self, logs: FloatArray) -> tuple[float, FloatArray]:
        """Return the negative log posterior of log lengths and log noise, and its gradient."""
        count, options = len(self.values), len(logs) - 1
        distances, factor, weights, variance = self.solve(logs)
        inverse = cho_solve((factor, True), np.eye(count))
        slope = 0.5 * (inverse - np.outer(weights, weights) / variance)
        # The derivative of the kernel by the log of a length is this times the squared distance along that option.
        outer = slope * (5.0 / 3.0) * (1.0 + _SQRT5 * distances) * np.exp(-_SQRT5 * distances)
        gradient = np.empty_like(logs)
        gradient[:-1] = np.tensordot(outer, self.squares, axes=2) * np.exp(-2.0 * logs[:-1])
        gradient[-1] = 2.0 * math.exp(2.0 * logs[-1]) * float(np.trace(slope))
        usual = 0.5 * math.log(options / 2.0)
        deviations = np.append((logs[:-1] - usual) / _LENGTH_DOUBT, (logs[-1] - math.log(_USUAL_NOISE)) / _NOISE_DOUBT)
        doubts = np.append(np.full(options, _LENGTH_DOUBT), _NOISE_DOUBT)
        cost = 0.5 * count * math.log(variance) + float(np.log(np.diag(factor)).sum())
        return cost + 0.5 * float(deviations @ deviations), gradient + deviations / doubts


def _squares(first: FloatArray, second: FloatArray, unordered: BoolArray) -> FloatArray:
    differences = first[:, np.newaxis] - second
    return np.where(unordered, np.abs(differences) > _SAME, differences**2).astype(np.float64)


def _matern(distances: FloatArray) -> FloatArray:
    scaled = _SQRT5 * distances
    return np.asarray((1.0 + scaled + scaled**2 / 3.0) * np.exp(-scaled))
