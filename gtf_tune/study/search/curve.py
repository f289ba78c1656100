"""Choose the next value of one variable from noisy values at a few places.

Expected improvement (Mockus, 1975; Jones et al., J. Global Optimization 13, 1998) under a Gaussian process with a
squared-exponential kernel, in numpy: one variable and some tens of places need neither torch nor an optimiser.
"""

import math
from dataclasses import dataclass

import numpy as np
from scipy.linalg import cho_solve, cholesky, solve_triangular
from scipy.special import ndtr

from gtf_tune.trajectory import FloatArray

LENGTHS = (0.1, 0.15, 0.2, 0.3, 0.45, 0.7, 1.0)
NOISES = (0.01, 0.03, 0.1, 0.3)
_USUAL_NOISE = 0.05
_NOISE_DOUBT = math.sqrt(2.0)
_SMALLEST = 1e-12


@dataclass(frozen=True, eq=False)
class Curve:
    """Gaussian process on [0, 1], fitted to values at places, both of shape (n,)."""

    places: FloatArray
    weights: FloatArray
    factor: FloatArray
    length: float
    variance: float
    centre: float

    def mean(self, places: FloatArray) -> FloatArray:
        """Return the expected values at places, (m,)."""
        return np.asarray(self.centre + _kernel(places, self.places, self.length) @ self.weights)

    def deviation(self, places: FloatArray) -> FloatArray:
        """Return the standard deviations of the curve at places, (m,)."""
        known = solve_triangular(self.factor, _kernel(self.places, places, self.length), lower=True)
        return np.asarray(np.sqrt(np.maximum(self.variance * (1.0 - (known**2).sum(axis=0)), _SMALLEST)))


def fit_curve(places: FloatArray, values: FloatArray) -> Curve:
    """Return the most likely curve through values (n,) at places (n,) in [0, 1], n >= 1.

    Length and noise come from a short list each, the variance has its most likely value. Noise is relative to the
    standard deviation of the curve, and expected to be about 5 % of it: without that expectation four points that lie
    on any smooth curve would be taken for free of noise.
    """
    fits = [_fit(places, values, length, noise) for length in LENGTHS for noise in NOISES]
    return max(fits, key=lambda fit: fit[0])[1]


def next_place(curve: Curve, candidates: FloatArray) -> float:
    """Return the candidate from which the largest improvement on the lowest known part of the curve is expected."""
    lowest = float(curve.mean(curve.places).min())
    expected = expected_improvement(lowest - curve.mean(candidates), curve.deviation(candidates))
    return float(candidates[int(np.argmax(expected))])


def expected_improvement(drop: FloatArray, deviation: FloatArray) -> FloatArray:
    """Return by how much values of these deviations, (m,), fall below a level in expectation, (m,).

    ``drop`` (m,) is how far their means lie below that level.
    """
    gain = drop / deviation
    density = np.exp(-0.5 * gain**2) / math.sqrt(2.0 * math.pi)
    return np.asarray(deviation * (gain * ndtr(gain) + density))


def _fit(places: FloatArray, values: FloatArray, length: float, noise: float) -> tuple[float, Curve]:
    count, centre = len(values), float(values.mean())
    factor = cholesky(_kernel(places, places, length) + noise**2 * np.eye(count), lower=True)
    weights = cho_solve((factor, True), values - centre)
    variance = max(float((values - centre) @ weights) / count, _SMALLEST)
    likelihood = -0.5 * count * math.log(variance) - float(np.log(np.diag(factor)).sum())
    prior = -0.5 * (math.log(noise / _USUAL_NOISE) / _NOISE_DOUBT) ** 2
    return likelihood + prior, Curve(places, weights, factor, length, variance, centre)


def _kernel(first: FloatArray, second: FloatArray, length: float) -> FloatArray:
    return np.asarray(np.exp(-0.5 * ((first[:, np.newaxis] - second) / length) ** 2))
