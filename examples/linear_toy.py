"""Rank configurations of a linear toy by their information and by GTF: with a few samples the orders agree.

    python examples/linear_toy.py

The unknowns x are estimated by least squares from measurements y = A x + noise. A configuration is a choice of rows of
A, as thresholds choose features. Its information A'A / sigma^2 needs A and sigma, which no pipeline gives. GTF needs
neither: it adds noise to the measurements and looks how far the estimate moves.
"""

import numpy as np

UNKNOWNS = 6
CONFIGURATIONS = tuple(range(12, 61, 8))
"""How many measurements each configuration uses."""
SIGMA = 0.5
ADDED_SIGMA = 0.3


def design(measurements: int) -> np.ndarray:
    """Return the matrix A of a configuration, of shape (measurements, UNKNOWNS)."""
    return np.random.default_rng(0).normal(size=(max(CONFIGURATIONS), UNKNOWNS))[:measurements]


def determinants() -> np.ndarray:
    """Return the logarithm of the determinant of each configuration's information; larger is better."""
    return np.array([np.linalg.slogdet(design(rows).T @ design(rows) / SIGMA**2)[1] for rows in CONFIGURATIONS])


def expected_errors() -> np.ndarray:
    """Return the expected RMS error of each configuration, from the trace of its inverse information."""
    return np.array(
        [
            np.sqrt(SIGMA**2 * np.trace(np.linalg.inv(design(rows).T @ design(rows))) / UNKNOWNS)
            for rows in CONFIGURATIONS
        ]
    )


def gtf_errors(samples: int, seed: int = 0, bias: float = 0.0) -> np.ndarray:
    """Return how far each configuration's estimate moves (RMS) over ``samples`` draws of added noise.

    ``bias`` is added to every measurement: an error of the model, which shifts all estimates alike.
    """
    generator = np.random.default_rng(seed)
    measured = design(max(CONFIGURATIONS)) @ generator.normal(size=UNKNOWNS) + bias
    measured += SIGMA * generator.normal(size=len(measured))
    added = ADDED_SIGMA * generator.normal(size=(samples, len(measured)))
    found = []
    for rows in CONFIGURATIONS:
        solve = np.linalg.pinv(design(rows))
        moved = (measured + added)[:, :rows] @ solve.T - solve @ measured[:rows]
        found.append(np.sqrt((moved**2).mean()))
    return np.array(found)


def agreement(samples: int, repetitions: int = 200) -> float:
    """Return the share of pairs of configurations that GTF orders as information does, over repetitions."""
    expected = expected_errors()
    first, second = np.triu_indices(len(CONFIGURATIONS), 1)
    truth = np.sign(expected[first] - expected[second])
    found = [gtf_errors(samples, seed) for seed in range(repetitions)]
    return float(np.mean([np.sign(moved[first] - moved[second]) == truth for moved in found]))


def samples_needed(share: float = 0.95) -> int:
    """Return the fewest of 1, 2, 4, ... samples with which that share of the pairs is in the right order."""
    return next(samples for samples in (2**power for power in range(12)) if agreement(samples) >= share)


if __name__ == "__main__":
    for power in range(6):
        print(f"{2**power:3d} samples: {agreement(2**power):4.0%} of the pairs in the order of information")
    print(f"95 % of them with {samples_needed()} samples")
