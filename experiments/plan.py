"""Say what is measured: sequences with their noise, options with their values, and the order of work."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import groupby
from pathlib import Path
from types import MappingProxyType
from typing import Any

from gtf_tune.definition import GtfDefinition

CLEAN_RUNS = 2
NOISY_RUNS = 6
MANY_NOISY_RUNS = 60
CONFIRMATION_RUNS = 12
TOP = 2
AGGREGATE = GtfDefinition().aggregate
"""What picks and confirmations go by: the default of gtf-tune."""

FIXED = MappingProxyType(
    {
        "mapper.bundle_adjustment.refine_focal_length": False,
        "mapper.bundle_adjustment.refine_extra_params": False,
    }
)
"""Intrinsics are known on every sequence here, so they are held fixed."""


@dataclass(frozen=True)
class Option:
    """One option of the paper's table 2, its values on a grid, and the head of its column there."""

    short: str
    name: str
    values: tuple[float, ...]
    paper_column: str


OPTIONS = MappingProxyType(
    {
        one.short: one
        for one in (
            Option(
                "ba", "mapper.max_normalized_reproj_error", (3e-4, 1e-3, 2e-3, 4e-3, 1e-2, 2e-2, 5e-2), "Max. BA e_r"
            ),
            Option(
                "huber",
                "mapper.bundle_adjustment.ceres.loss_function_scale",
                (0.03, 0.1, 0.2, 0.5, 1.0, 2.0, 5.0),
                "BA Huber loss",
            ),
            Option(
                "twoview", "verification.ransac.max_error", (0.5, 1.0, 2.0, 3.0, 4.0, 8.0, 16.0), "2V geo. max. e_r"
            ),
            # At 0.9 the pairs of dtu-scan24 are full of outliers, and verifying them takes minutes a run.
            Option("ratio", "matching.sift.max_ratio", (0.6, 0.65, 0.7, 0.75, 0.8, 0.85), "SIFT max. ratio"),
            Option(
                "peak",
                "extraction.sift.peak_threshold",
                (0.002, 0.0033, 0.005, 0.02 / 3, 0.01, 0.015, 0.02),
                "SIFT ext. peak",
            ),
        )
    }
)

ROOM = "room"
"""The rendered room, which needs no data."""

SIGMAS = MappingProxyType(
    {ROOM: 5.0, "dtu-scan24": 2.0, "fountain-P11": 5.0, "hut": 5.0, "kitti07": 5.0, "kitti06": 5.0}
)
"""Noise in grey levels; 384 x 384 images with few features need less (docs/results-appendix.md, noise ladder)."""

DEFAULT_SIGMA = 5.0


@dataclass(frozen=True)
class Truth:
    """Say in which unit a ground truth is, none where the scale is arbitrary, and how good it is."""

    unit: str
    quality: str


TRUTHS = MappingProxyType(
    {
        ROOM: Truth("", "exact (rendered)"),
        "dtu-scan24": Truth("mm", "robot arm"),
        "fountain-P11": Truth("m", "laser, mm"),
        "hut": Truth("", "exact (rendered)"),
        "kitti07": Truth("m", "GPS/IMU, dm"),
        "kitti06": Truth("m", "GPS/IMU, dm"),
    }
)
UNKNOWN_TRUTH = Truth("", "unknown")

WEAKER = MappingProxyType(
    {"dtu-scan24": 0.5, "fountain-P11": 2.0, ROOM: 0.5, "hut": 0.5, "kitti07": 0.5, "kitti06": 0.5}
)
"""A second level of noise, to see what depends on it: mostly the one that ladders recommend."""

_TRAP = Option("inliers", "verification.min_num_inliers", (15, 120, 300, 500, 800), "2V geom. min num inliers")

FRAMES: Mapping[str, Mapping[str, Any]] = MappingProxyType(
    {
        "kitti06": MappingProxyType({"max_frames": 24, "max_image_size": 620}),
        "kitti07": MappingProxyType({"max_frames": 20, "max_image_size": 620}),
    }
)
"""What is used of a sequence, all where nothing is said: a run on one of these as it is takes minutes on one thread."""

_CHEAP = ("ba", "huber", "twoview")
_CHEAPEST = ("huber", "ba")
_SMALL = (ROOM, "dtu-scan24", "fountain-P11")


@dataclass(frozen=True)
class Experiment:
    """Name one grid: a sequence, an option and the noise."""

    sequence: str
    option: Option
    sigma: float
    noisy_runs: int = NOISY_RUNS

    @property
    def study(self) -> str:
        """Return the name of its study."""
        name = f"{self.sequence}.{self.option.short}.s{self.sigma:g}"
        return name if self.noisy_runs == NOISY_RUNS else f"{name}.k{self.noisy_runs}"

    def definition(self, path: Path) -> dict[str, Any]:
        """Return the definition of its study; ``path`` is the folder of the sequence."""
        return {
            "name": self.study,
            "pipeline": {"name": "glomap", "options": dict(FIXED)},
            "sequences": [sequence_of(self.sequence, path)],
            "space": {self.option.name: {"values": list(self.option.values)}},
            "gtf": {
                "clean_runs": CLEAN_RUNS,
                "noisy_runs": self.noisy_runs,
                "noise_sigma": self.sigma,
                "aggregate": AGGREGATE,
            },
            "search": {"sampler": "grid"},
        }


def sequence_of(name: str, path: Path) -> dict[str, Any]:
    """Return a sequence as definitions name it, with the frames that are used."""
    return {"name": name, "path": str(path), **FRAMES.get(name, {})}


def experiments(
    found: Mapping[str, Path], sequences: Sequence[str] = (), options: Sequence[str] = ()
) -> list[Experiment]:
    """Return the grids to measure, the cheap ones on small sequences first.

    ``found`` are the sequences that exist; ``sequences`` and ``options`` choose among them, all where empty.
    """
    chosen = [name for name in (sequences or sorted(found)) if name in found]
    kinds = [OPTIONS[name] for name in (options or OPTIONS)]
    planned = [Experiment(name, option, SIGMAS.get(name, DEFAULT_SIGMA)) for name in chosen for option in kinds]
    return sorted(planned, key=lambda one: (*_batch(one), *_place(one)))


def other_sigmas(found: Mapping[str, Path]) -> list[Experiment]:
    """Return the grids of table 2 again, with weaker noise, the cheap options first."""
    return [
        Experiment(name, OPTIONS[short], sigma)
        for short in (*_CHEAPEST, "twoview", "ratio", "peak")
        for name, sigma in WEAKER.items()
        if name in found
    ]


def confirmed_with_weaker_noise(found: Mapping[str, Path]) -> list[Experiment]:
    """Return those of `other_sigmas` that are confirmed too: the cheap ones."""
    return [other_sigma for other_sigma in other_sigmas(found) if other_sigma.option.short in _CHEAPEST]


def many_noisy_runs(found: Mapping[str, Path]) -> list[Experiment]:
    """Return the grids that show what more noisy runs are worth (the paper shows 1 to 60)."""
    kinds = [OPTIONS["huber"], replace(OPTIONS["ba"], values=OPTIONS["ba"].values[1:])]
    return [Experiment(ROOM, kind, SIGMAS[ROOM], MANY_NOISY_RUNS) for kind in kinds if ROOM in found]


def traps(found: Mapping[str, Path]) -> list[Experiment]:
    """Return grids over options that drop frames at their strict ends, which can lower the error over the rest."""
    return [Experiment(name, _TRAP, SIGMAS[name]) for name in (ROOM, "dtu-scan24") if name in found]


def batches(planned: Sequence[Experiment]) -> list[list[Experiment]]:
    """Return planned experiments in groups that are measured and then confirmed, one group after the other."""
    return [list(group) for _, group in groupby(planned, key=_batch)]


def _batch(one: Experiment) -> tuple[bool, bool]:
    return one.sequence not in _SMALL, one.option.short not in _CHEAP


def _place(one: Experiment) -> tuple[int, int]:
    known = [*SIGMAS, one.sequence]
    return known.index(one.sequence), list(OPTIONS).index(one.option.short)
