"""Search all five options of table 2 at once, and compare with the sweeps of one for the same number of runs."""

import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from experiments.measure import Bench, confirm_study, finish_study
from experiments.plan import (
    AGGREGATE,
    FIXED,
    OPTIONS,
    ROOM,
    SIGMAS,
    Experiment,
    sequence_of,
)
from experiments.settings import PREDICTORS, Outcome
from gtf_tune.store import confirmations, ground_truth_errors, studies, trials
from gtf_tune.store.database import Database
from gtf_tune.study.outcome.verdict import verdict_of

SEQUENCES = (ROOM, "dtu-scan24")
TRIALS = 35
CLEAN, NOISY = 1, 4
"""Fewer runs a trial than the grids take: many cheap trials and a confirmation beat few expensive ones."""

# The ends of the grids; ratios beyond make two-view verification slow, see `plan`.
_SPACE = {
    "mapper.max_normalized_reproj_error": {"low": 3e-4, "high": 5e-2, "log": True},
    "mapper.bundle_adjustment.ceres.loss_function_scale": {"low": 0.03, "high": 5.0, "log": True},
    "verification.ransac.max_error": {"low": 0.5, "high": 16.0, "log": True},
    "matching.sift.max_ratio": {"low": 0.6, "high": 0.82},
    "extraction.sift.peak_threshold": {"low": 0.002, "high": 0.02, "log": True},
}


@dataclass(frozen=True)
class Joint:
    """A joint search: true ATEs of nominal, of the pick and of the best trial, and what it cost."""

    sequence: str
    sampler: str
    trials: int
    runs: int
    nominal: float
    pick: float
    oracle: float
    options: Mapping[str, Any]
    verdict: str
    adopted: float | None

    def change(self, true_ate: float) -> float:
        """Return a true error relative to nominal's, negative where it is better."""
        return true_ate / self.nominal - 1


def study_name(sequence: str) -> str:
    """Return the name of the study of a sequence."""
    return f"{sequence}.joint.s{SIGMAS[sequence]:g}"


def definition(sequence: str, path: Path) -> dict[str, Any]:
    """Return the definition of the study; its sampler is gtf-tune's default for several options."""
    gtf = {"clean_runs": CLEAN, "noisy_runs": NOISY, "noise_sigma": SIGMAS[sequence], "aggregate": AGGREGATE}
    return {
        "name": study_name(sequence),
        "pipeline": {"name": "glomap", "options": dict(FIXED)},
        "sequences": [sequence_of(sequence, path)],
        "space": _SPACE,
        "gtf": gtf,
        "search": {"trials": TRIALS},
    }


def run_joint(bench: Bench, sequence: str, confirmation_runs: int) -> None:
    """Complete and confirm the joint search of a sequence, or raise `Interrupted`."""
    finish_study(bench, study_name(sequence), definition(sequence, bench.folders[sequence]))
    confirm_study(bench, study_name(sequence), confirmation_runs)


def read_joint(database: Database, sequence: str) -> Joint | None:
    """Return a finished joint search, None where it is not finished."""
    name = study_name(sequence)
    if name not in studies.names(database):
        return None
    study = studies.get(database, name)
    if study.state != "done":
        return None
    known = [one for one in trials.of_study(database, study.id) if one.state in ("complete", "pruned")]
    stored = ground_truth_errors.of_study(database, study.id)
    truth = {key: found[0].ate for key, found in stored.items() if found and found[0].ate is not None}
    best = trials.best(database, study.id)
    feasible = [one.number for one in known if one.feasible and one.number in truth]
    if best is None or not {0, best.number} <= truth.keys():
        return None
    confirmed = confirmations.of_study(database, study.id)
    adopted = (verdict_of(confirmed[-1]).adopted or 0) if confirmed else None
    return Joint(
        sequence=sequence,
        sampler=str(json.loads(study.definition)["search"]["sampler"]),
        trials=len(known),
        runs=sum((one.clean_runs or 0) + (one.noisy_runs or 0) for one in known),
        nominal=truth[0],
        pick=truth[best.number],
        oracle=min(truth[number] for number in feasible),
        options=dict(best.options or {}),
        verdict=confirmed[-1].verdict if confirmed else "unconfirmed",
        adopted=None if adopted is None else truth[adopted],
    )


def sweeps_of(sequence: str, outcomes: Sequence[Outcome]) -> list[tuple[Experiment, int, float]]:
    """Return each sweep of a sequence with its runs and what its pick changes."""
    found = []
    for outcome in outcomes:
        if outcome.experiment.sequence == sequence and outcome.experiment.option.short in OPTIONS:
            pick = outcome.agreement(PREDICTORS[AGGREGATE]).pick
            runs = len(outcome.settings) * sum(outcome.nominal.matrix.shape)
            found.append((outcome.experiment, runs, outcome.change(pick)))
    return found
