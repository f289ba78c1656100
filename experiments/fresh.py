"""Judge what confirmations compared by ground truth on the confirmations' own noise, which no search has seen."""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from scipy import stats

from experiments.numbers import Table, percent, spearman
from experiments.plan import Experiment
from experiments.settings import Outcome, true_ates
from gtf_tune.gtf.random_effects import far_from_median
from gtf_tune.store import confirmations, runs, studies
from gtf_tune.store.database import Database
from gtf_tune.store.runs import trajectories
from gtf_tune.study.outcome.verdict import Candidate, verdict_of
from gtf_tune.trajectory import FloatArray, Trajectory

_FEWEST = 3

Errors = Mapping[int, float]
"""True ATEs by the number of the noisy run."""


@dataclass(frozen=True)
class FreshError:
    """What ground truth says of one candidate on the noisy images of its confirmation.

    ``change`` is the geometric mean over the noisy runs of the true ATE relative to nominal's under the same noise,
    minus one, without runs far from the others; negative is better. ``low`` and ``high`` are its 95 % interval, by
    Student's t on the logarithms. ``score`` is the change that the confirmation found without ground truth, and
    ``clean`` that of the true ATE on the clean images. ``better`` of ``runs`` noisy runs have a smaller true ATE.
    """

    study: str
    value: float
    is_adopted: bool
    score: float
    change: float
    low: float
    high: float
    better: int
    runs: int
    clean: float


def read_fresh(database: Database, outcome: Outcome, truth: Trajectory | None) -> list[FreshError]:
    """Return the candidates of the last confirmation; empty where there is none, or no ground truth at hand."""
    experiment = outcome.experiment
    if truth is None or experiment.study not in studies.names(database):
        return []
    stored = confirmations.of_study(database, studies.get(database, experiment.study).id)
    verdict = verdict_of(stored[-1]) if stored else None
    if verdict is None or verdict.nominal is None:
        return []
    name = experiment.option.name
    value = float(verdict.nominal.options[name])
    errors = _errors(database, experiment, stored[-1].definition["run_keys"], value, truth)
    return [
        judged(
            outcome,
            candidate,
            errors[value],
            errors[float(candidate.options[name])],
            candidate.number == verdict.adopted,
        )
        for candidate in verdict.candidates
    ]


def judged(outcome: Outcome, candidate: Candidate, nominal: Errors, own: Errors, is_adopted: bool) -> FreshError:
    """Return what ground truth says of a candidate of a confirmation."""
    value = float(candidate.options[outcome.experiment.option.name])
    common = sorted(index for index in nominal.keys() & own.keys() if nominal[index] > 0 and own[index] > 0)
    logs = np.array([math.log(own[index] / nominal[index]) for index in common])
    change, low, high = _interval(logs[~far_from_median(logs)] if len(logs) else logs)
    clean = next((outcome.change(setting) for setting in outcome.settings if setting.value == value), math.nan)
    return FreshError(
        outcome.experiment.study,
        value,
        is_adopted,
        -candidate.improvement.value,
        change,
        low,
        high,
        int((logs < 0).sum()),
        len(logs),
        clean,
    )


def fresh_table(found: Sequence[FreshError]) -> Table:
    """Return one row for each candidate of each confirmation."""
    columns = ["study", "value", "verdict", "score", "true ATE, 95 % interval", "better in", "true ATE on clean images"]
    rows = [
        [
            one.study,
            f"{one.value:.3g}",
            "**adopt**" if one.is_adopted else "",
            percent(one.score),
            f"{percent(one.change)} ({percent(one.low)} to {percent(one.high)})",
            f"{one.better} of {one.runs}",
            percent(one.clean),
        ]
        for one in found
    ]
    return columns, rows


def fresh_sentence(found: Sequence[FreshError]) -> str:
    """Return what is true of all that was adopted, in words; empty where nothing was."""
    adopted = [one for one in found if one.is_adopted and math.isfinite(one.change)]
    if not adopted:
        return ""
    worse = [one for one in adopted if one.change > 0]
    sure = sum(one.high < 0 for one in adopted)
    named = f" ({', '.join(f'{one.study} {percent(one.change)}' for one in worse)})" if worse else ""
    changes = [one.change for one in adopted]
    known = [one for one in found if math.isfinite(one.change) and math.isfinite(one.score)]
    rank = spearman([one.score for one in known], [one.change for one in known])
    return (
        f"On the fresh noisy images of the confirmations {len(worse)} of the {len(adopted)} adopted settings have a "
        f"larger true ATE than nominal{named}; changes go from {percent(min(changes))} to {percent(max(changes))}, and "
        f"{sure} intervals lie below zero. Over all {len(known)} candidates that were confirmed or turned down, "
        f"Spearman's correlation of the change of the score with that of the true ATE is {rank:+.2f}."
    )


def _errors(
    database: Database, experiment: Experiment, keys: Sequence[str], nominal: float, truth: Trajectory
) -> dict[float, dict[int, float]]:
    """Return the true ATEs of noisy runs by the value of the option; where a run does not name it, it is nominal's."""
    noisy = [one for one in runs.find(database, keys).values() if one.kind == "noisy"]
    poses = trajectories(database, [one.key for one in noisy])
    ates = true_ates(truth, [poses[one.key] for one in noisy]).tolist()
    found: dict[float, dict[int, float]] = {}
    for one, error in zip(noisy, ates, strict=True):
        found.setdefault(float(one.options.get(experiment.option.name, nominal)), {})[one.index] = error
    return found


def _interval(logs: FloatArray) -> tuple[float, float, float]:
    """Return the mean of logarithms of ratios and the ends of its 95 % interval, each as a relative change."""
    if len(logs) < _FEWEST:
        return math.nan, math.nan, math.nan
    mean, error = float(np.mean(logs)), float(np.std(logs, ddof=1)) / math.sqrt(len(logs))
    half = float(stats.t.ppf(0.975, len(logs) - 1)) * error
    return math.expm1(mean), math.expm1(mean - half), math.expm1(mean + half)
