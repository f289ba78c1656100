"""Turn the stored runs of the bank into its one small file."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from experiments.bank.bank import COPIES, PER_RUN, STAGES, Bank
from experiments.bank.fill import Depot
from experiments.bank.plan import CONFIGURATIONS, NOMINAL, SEQUENCES, SIGMAS, BankSequence
from gtf_tune.definition import LimitsDefinition
from gtf_tune.metrics import pairwise_matrix
from gtf_tune.store import runs
from gtf_tune.store.database import Database
from gtf_tune.store.runs import StoredRun, trajectories
from gtf_tune.study.runs.run_source import failed_key, run_limits
from gtf_tune.trajectory import FloatArray, Trajectory

_DIAGNOSTICS: Mapping[str, str] = {
    "points": "num_points3D",
    "track_length": "mean_track_length",
    "epipolar": "epipolar_px",
    "epipolar_unused": "epipolar_unused_px",
    "covariance": "covariance",
}


@dataclass(frozen=True, eq=False)
class _Runs:
    """Runs of one configuration on one sequence in the order of `COPIES`; ``None`` where there is none yet."""

    stored: tuple[StoredRun | None, ...]
    poses: tuple[Trajectory, ...]

    @property
    def succeeded(self) -> list[int]:
        return [place for place, poses in enumerate(self.poses) if len(poses)]


def pack(depot: Depot) -> Bank:
    """Return the bank of all runs that are stored so far."""
    database = depot.database()
    known = [sequence for sequence in SEQUENCES if depot.has(sequence)]
    found = [_of_sequence(depot, database, sequence) for sequence in known]
    stacked = {name: np.stack([one[name] for one in found]) for name in found[0]}
    return Bank(
        sequences=tuple(sequence.name for sequence in known),
        groups=tuple(sequence.grouped for sequence in known),
        labels=tuple(CONFIGURATIONS),
        per_run={name: stacked.pop(name) for name in PER_RUN},
        **stacked,
    )


def _of_sequence(depot: Depot, database: Database, wanted: BankSequence) -> dict[str, FloatArray]:
    sequence = depot.sequence(wanted)
    truth = sequence.ground_truth
    if truth is None:
        raise RuntimeError(f"{wanted.name} has no ground truth; the bank needs it")
    by_label = {label: _runs(depot, database, wanted, label) for label in CONFIGURATIONS}
    extent = float(np.sqrt(np.var(truth.positions, axis=0).sum()))
    rows = [_of_configuration(runs_, by_label[NOMINAL], truth, extent, len(sequence)) for runs_ in by_label.values()]
    stacked = {name: np.stack([row[name] for row in rows]) for name in rows[0]}
    return {**stacked, "extents": np.array(extent), "frames": np.array(float(len(sequence)))}


def _runs(depot: Depot, database: Database, sequence: BankSequence, label: str) -> _Runs:
    requests = [depot.request(sequence, copy, label) for copy in COPIES]
    limits = run_limits(LimitsDefinition())
    keys = [(request.key, failed_key(request, limits)) for request in requests]
    known = runs.find(database, [key for both in keys for key in both])
    stored = tuple(next((known[key] for key in both if key in known), None) for both in keys)
    poses = trajectories(database, [run.key for run in stored if run is not None])
    empty = Trajectory.empty()
    return _Runs(stored, tuple(empty if run is None else poses[run.key] for run in stored))


def _of_configuration(
    found: _Runs, nominal: _Runs, truth: Trajectory, extent: float, frames: int
) -> dict[str, FloatArray]:
    per_run = {name: np.full(len(COPIES), np.nan) for name in PER_RUN}
    for place, run in enumerate(found.stored):
        if run is None:
            continue
        per_run["registered"][place] = len(found.poses[place]) / frames
        for name, diagnostic in _DIAGNOSTICS.items():
            value = run.diagnostics.get(diagnostic, np.nan)
            per_run[name][place] = np.nan if value == -1 else value
    good = found.succeeded
    per_run["true"][good] = pairwise_matrix([truth], [found.poses[place] for place in good]).errors[0] / extent
    return {
        **per_run,
        "pairs": _pairs(found),
        "to_nominal": _to_nominal(found, nominal),
        "seconds": _seconds([run for run in found.stored if run is not None]),
    }


def _pairs(found: _Runs) -> FloatArray:
    """Return relative errors of pairs, without those of which no rule makes use."""
    pairs, good = np.full((len(COPIES), len(COPIES)), np.nan), found.succeeded
    poses = [found.poses[place] for place in good]
    errors = pairwise_matrix(poses, poses)
    pairs[np.ix_(good, good)] = errors.errors / errors.extents
    sigmas = np.array([copy.sigma for copy in COPIES])
    wanted = (sigmas[:, None] == 0) | ((sigmas[:, None] == SIGMAS[0]) & (sigmas == SIGMAS[0]))
    return np.where(np.triu(wanted, 1), pairs, np.nan)


def _to_nominal(found: _Runs, nominal: _Runs) -> FloatArray:
    errors = np.full(len(COPIES), np.nan)
    for place in set(found.succeeded) & set(nominal.succeeded):
        pair = pairwise_matrix([nominal.poses[place]], [found.poses[place]])
        errors[place] = pair.errors[0, 0] / pair.extents[0, 0]
    return errors


def _seconds(stored: Sequence[StoredRun]) -> FloatArray:
    built = [
        [float(run.diagnostics[f"{stage}_s"]) for run in stored if run.diagnostics.get(f"{stage}_s", 0.0)]
        for stage in STAGES
    ]
    return np.array([float(np.median(values)) if values else np.nan for values in built])


def without_unrun(bank: Bank) -> Bank:
    """Return the bank without the configurations that no sequence has a run of."""
    kept = np.flatnonzero(bank.present.any(axis=(0, 2)))
    return replace(
        bank,
        labels=tuple(bank.labels[place] for place in kept),
        pairs=bank.pairs[:, kept],
        to_nominal=bank.to_nominal[:, kept],
        per_run={name: values[:, kept] for name, values in bank.per_run.items()},
        seconds=bank.seconds[:, kept],
    )
