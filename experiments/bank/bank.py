"""The bank as a value: what was measured of every run, and the one small file that keeps it."""

import json
from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np

from experiments.bank.plan import NOISY_RUNS, Copy, copies
from gtf_tune.trajectory import BoolArray, FloatArray, IntArray

BANK_FILE = Path("experiments/bank/runs.npz")

COPIES: tuple[Copy, ...] = tuple(sorted(copies(4, *NOISY_RUNS), key=lambda copy: (copy.sigma, copy.index)))
"""The runs of one configuration on one sequence in the order of the arrays: clean ones, then noisy ones by level."""

STAGES = ("images", "features", "matches", "geometry", "positioning", "mapping")
PER_RUN = ("true", "registered", "points", "track_length", "epipolar", "epipolar_unused", "covariance")
"""What is kept of each run by name.

``true`` is the ATE against ground truth over its extent; ``registered`` the share of frames, 0 of a failed run;
``epipolar`` and ``epipolar_unused`` are medians in pixels (see `pipeline`); ``covariance`` the deviation that the
adjustment predicts, over the extent.
"""

_MANTISSA_BITS = 12


@dataclass(frozen=True, eq=False)
class Bank:
    """Runs of c configurations on s sequences, r copies each in the order of `COPIES`; NaN where there is no run yet.

    Attributes
    ----------
    pairs
        (s, c, r, r): ATE of run j against run i < j over the extent of run i, where i is clean or both are of the
        weaker level; NaN elsewhere and where they cannot be compared.
    to_nominal
        (s, c, r): ATE of a run against that of the nominal configuration on the same copy, over the extent of nominal.
    per_run
        (s, c, r) by the names in `PER_RUN`.
    seconds
        (s, c, stages): median processor time of each stage where it was built; NaN where it never was.
    extents
        (s,): RMS distance of the ground truth from its mean, in its own unit.
    frames
        (s,): frames of each sequence.
    """

    sequences: tuple[str, ...]
    groups: tuple[str, ...]
    labels: tuple[str, ...]
    pairs: FloatArray
    to_nominal: FloatArray
    per_run: Mapping[str, FloatArray]
    seconds: FloatArray
    extents: FloatArray
    frames: FloatArray

    @cached_property
    def present(self) -> BoolArray:
        """Return which runs exist, (s, c, r), failed ones included."""
        return ~np.isnan(self.per_run["registered"])

    def columns(self, sigma: float) -> IntArray:
        """Return the places of the copies of one level along the axis of runs; level 0 is that of the clean runs."""
        return np.flatnonzero([copy.sigma == sigma for copy in COPIES])

    def save(self, path: Path) -> None:
        """Write the file; numbers keep some four digits."""
        names = {name: getattr(self, name) for name in ("sequences", "groups", "labels")}
        arrays = {name: getattr(self, name) for name in ("pairs", "to_nominal", "seconds", "extents", "frames")}
        arrays |= {f"run_{name}": values for name, values in self.per_run.items()}
        rounded: dict[str, Any] = {name: _rounded(values) for name, values in arrays.items()}
        np.savez_compressed(path, names=np.array(json.dumps(names)), **rounded)


def load(path: Path = BANK_FILE) -> Bank:
    with np.load(path, allow_pickle=False) as stored:
        arrays: dict[str, Any] = {name: stored[name].astype(np.float64) for name in stored.files if name != "names"}
        names = json.loads(str(stored["names"]))
    per_run = {name: arrays.pop(f"run_{name}") for name in PER_RUN}
    arrays |= {name: tuple(values) for name, values in names.items()}
    return Bank(per_run=per_run, **arrays)


def _rounded(values: FloatArray) -> "np.ndarray[tuple[int, ...], np.dtype[np.float32]]":
    """Return the values as single precision with few digits, which compress well."""
    mask = np.uint32(0xFFFFFFFF << (23 - _MANTISSA_BITS) & 0xFFFFFFFF)
    bits = np.ascontiguousarray(values, np.float32).view(np.uint32)
    half = np.uint32(1 << (22 - _MANTISSA_BITS))
    finite = np.isfinite(values)
    return np.where(finite, (bits + half) & mask, bits).view(np.float32)
