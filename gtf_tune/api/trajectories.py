"""Read the trajectories of many runs of any program, and score them."""

import glob
import os
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from natsort import natsorted

from gtf_tune.errors import TrajectoryError
from gtf_tune.gtf import Aggregate, GtfScore, GtfSettings, Normalise, score_of_pairs
from gtf_tune.metrics import associated_matrix
from gtf_tune.trajectory import (
    MAX_DIFFERENCE_S,
    Association,
    BoolArray,
    FloatArray,
    IntArray,
    Trajectory,
    TrajectoryFormat,
    association_of,
    read_trajectory,
)
from gtf_tune.trajectory.alignment import AlignmentKind

_SUFFIXES = frozenset({"", ".bin", ".csv", ".euroc", ".kitti", ".tum", ".txt"})
_MODEL_FILES = ("images.bin", "images.txt")
_PER_MILLE = 1000


@dataclass(frozen=True, eq=False)
class GtfAte:
    """Ground-truth-free score of trajectories, as `gtf_ate` returns it.

    Attributes
    ----------
    value
        Aggregate over all pairs of a noisy and a clean trajectory, in ``unit``; smaller is more precise.
    interval
        95 % confidence interval of ``value``; NaN where there are too few runs for one.
    matrix
        (k, k_delta) error of noisy trajectory j against clean trajectory i, in ``unit``; NaN where there is none.
    matched
        (k, k_delta) number of poses that were compared.
    pair_errors
        Why pair (i, j) has no error.
    collapsed
        (k_delta,) which noisy trajectories fell apart (`gtf_tune.gtf.find_collapsed`).
    unit
        ``"extent"``: a fraction of the RMS distance of the clean positions from their mean; ``"none"``: the unit of the
        clean positions.
    association
        What poses were associated by: ``"name"``, ``"timestamp"``, ``"frame id"`` or ``"order"``.
    clean, noisy
        Where the k and the k_delta trajectories were read from; empty texts for those made in Python.
    """

    value: float
    interval: tuple[float, float]
    matrix: FloatArray
    matched: IntArray
    pair_errors: dict[tuple[int, int], str]
    collapsed: BoolArray
    unit: Normalise
    association: Association
    clean: tuple[str, ...]
    noisy: tuple[str, ...]

    def __str__(self) -> str:
        factor, unit = (_PER_MILLE, " per mille of the extent") if self.unit == "extent" else (1, "")
        low, high = (factor * end for end in self.interval)
        known = f"95 % interval {low:.3g} to {high:.3g}" if np.isfinite([low, high]).all() else "no interval"
        clean, noisy = self.matrix.shape
        runs = f"{clean} clean and {noisy} noisy trajectories associated by {self.association}"
        return f"GTF ATE {factor * self.value:.3g}{unit} ({known}; {runs})"


def load_trajectories(*paths: str | os.PathLike[str], format: TrajectoryFormat = "auto") -> list[Trajectory]:
    """Read the trajectories of several runs, in natural order (``run2`` before ``run10``).

    Parameters
    ----------
    paths
        Each is a trajectory file, a COLMAP model, a folder of them, or a glob pattern such as ``runs/*/poses.txt``. A
        folder gives its files that have no suffix or one of .txt, .csv, .tum, .kitti, .euroc and .bin, and its
        subfolders that are COLMAP models or hold some (of several, as COLMAP writes them, the one with most images).
    format
        ``auto``, ``tum``, ``kitti``, ``euroc``, ``colmap``, ``transforms``, ``opensfm`` or ``sfmdata``, for all of
        them; see
        `gtf_tune.trajectory.read_trajectory`.

    Returns
    -------
    list of Trajectory
        World-from-camera poses; ``source`` is the path of each.

    Raises
    ------
    TrajectoryError
        Nothing is found at a path, or a file cannot be read as a trajectory; the message names it.
    """
    return [_read(source, format) for path in paths for source in _sources(path)]


def gtf_ate(
    clean: Sequence[Trajectory],
    noisy: Sequence[Trajectory],
    *,
    aggregate: Aggregate = "median",
    alignment: AlignmentKind = "sim3",
    normalise: Normalise = "extent",
    max_difference_s: float = MAX_DIFFERENCE_S,
) -> GtfAte:
    """Return the GTF ATE of a program from trajectories that it made of clean and of noisy images.

    The less trajectories move under image noise, the more precise the program is: the score aggregates the absolute
    trajectory errors of all pairs of a noisy and a clean trajectory (Fontan et al., arXiv 2412.01116, eq. "metric").

    Poses of a pair are associated by image name where all trajectories have names, else by timestamp (the nearest one
    in time, as evo does), else by frame id. Frame ids that only count the lines of files are matched only where all
    trajectories have as many poses.

    Parameters
    ----------
    clean, noisy
        k trajectories from clean images and k_delta from noisy ones, world-from-camera, each in a world frame and scale
        of its own; those of failed runs are `Trajectory.empty`.
    aggregate
        How k * k_delta errors become one number: ``median`` (as studies do by default), ``mean`` (the paper's),
        ``gmean`` or ``trimmed``.
    alignment
        ``sim3`` fits scale, rotation and translation before errors are taken, ``se3`` no scale, ``none`` nothing.
    normalise
        ``extent`` divides each error by the RMS distance of the clean positions from their mean; ``none``, the paper's
        formula, leaves it in the unit of the clean positions.
    max_difference_s
        How far apart two timestamps may be to belong together, in seconds; evo's default.

    Raises
    ------
    TrajectoryError
        There are no clean or no noisy trajectories, nothing says which of their poses belong together, or not one pair
        can be compared.
    DefinitionError
        A word is unknown.
    """
    settings = GtfSettings(aggregate=aggregate, alignment=alignment, normalise=normalise)
    for kind, runs in (("clean", clean), ("noisy", noisy)):
        if not any(len(run) for run in runs):
            raise TrajectoryError(f"expected at least one {kind} trajectory with poses, but there is none")
    association = association_of([*clean, *noisy])
    pairs = associated_matrix(clean, noisy, association, settings.pair_metric, max_difference_s)
    if len(pairs.reasons) == pairs.errors.size:
        raise TrajectoryError(_incomparable(clean, noisy, association, pairs.reasons))
    counts = [len(run) for run in clean], [len(run) for run in noisy]
    score = score_of_pairs(pairs, settings, *counts, num_frames=max(map(max, counts)))
    return _result(score, association, clean, noisy)


def _result(
    score: GtfScore, association: Association, clean: Sequence[Trajectory], noisy: Sequence[Trajectory]
) -> GtfAte:
    return GtfAte(
        value=score.value,
        interval=score.confidence_interval,
        matrix=score.matrix,
        matched=score.matched,
        pair_errors=score.pair_errors,
        collapsed=score.collapsed,
        unit=score.settings.normalise,
        association=association,
        clean=tuple(run.source for run in clean),
        noisy=tuple(run.source for run in noisy),
    )


def _incomparable(
    clean: Sequence[Trajectory],
    noisy: Sequence[Trajectory],
    association: Association,
    reasons: dict[tuple[int, int], str],
) -> str:
    (i, j), reason = next(
        ((pair, reason) for pair, reason in reasons.items() if len(clean[pair[0]]) and len(noisy[pair[1]])),
        next(iter(reasons.items())),
    )
    names = (clean[i].source or f"clean trajectory {i}", noisy[j].source or f"noisy trajectory {j}")
    called = [f"'{next(iter(run.names), '')}'" for run in (clean[i], noisy[j])]
    advice = {
        "timestamp": "; give both by the same clock in seconds, or a larger tolerance",
        "name": f"; give models of the same images under the same names, not {called[0]} and {called[1]}",
    }.get(association, "")
    return f"{names[0]} and {names[1]}, associated by {association}: {reason}{advice}"


def _sources(path: str | os.PathLike[str]) -> list[Path]:
    """Return the files and the folders of models at a path or of a pattern, in natural order."""
    place = Path(path).expanduser()
    if place.is_dir():
        found = [place] if _models(place, ("", "sparse", "sparse/*")) else _in_folder(place)
    elif place.is_file():
        found = [place]
    else:
        found = [Path(match) for match in glob.glob(str(place), recursive=True)]
    if not found:
        raise TrajectoryError(f"expected trajectory files or COLMAP models at {place}, but there are none")
    return list(natsorted(found, key=str))


def _in_folder(folder: Path) -> list[Path]:
    return [
        entry
        for entry in folder.iterdir()
        if not entry.name.startswith(".")
        and (entry.suffix.lower() in _SUFFIXES if entry.is_file() else bool(_models(entry)))
    ]


def _models(folder: Path, where: Sequence[str] = ("", "sparse", "sparse/*", "*")) -> list[Path]:
    """Return the folders of COLMAP models in a folder, at the first of the places that have any."""
    for pattern in where:
        places = sorted(folder.glob(pattern)) if pattern else [folder]
        found = [place for place in places if any((place / name).is_file() for name in _MODEL_FILES)]
        if found:
            return found
    return []


def _read(source: Path, format: TrajectoryFormat) -> Trajectory:
    if not source.is_dir():
        return read_trajectory(source, format)
    return max(_read_models(source), key=len)


def _read_models(source: Path) -> Iterator[Trajectory]:
    models = _models(source)
    if not models:
        raise TrajectoryError(f"expected a COLMAP model with images.bin or images.txt in {source}, but there is none")
    for model in models:
        yield read_trajectory(model, "colmap")
