"""Record what a trial found, in Optuna's terms and in ours."""

import math
from typing import Any

from optuna.trial import Trial

from gtf_tune.store.optuna import trials as optuna_trials
from gtf_tune.store.optuna.retrying_storage import gathered
from gtf_tune.store.trial_queue import TrialResult
from gtf_tune.study.outcome.improvement import (
    UNKNOWN_IMPROVEMENT,
    Improvement,
    paired_improvement,
    score_matrices,
    stored_matrices,
)
from gtf_tune.study.runs.sequence_runs import SequenceRuns
from gtf_tune.study.scoring.objective import SequenceScore
from gtf_tune.study.scoring.trial_scorer import ScoredTrial

COVERAGE_CONSTRAINT = "coverage"


def report_instances(trial: Trial, scored: ScoredTrial) -> None:
    """Report the value of each new noisy instance as an intermediate value, its number being the step."""
    known = len(optuna_trials.known(trial).intermediate_values)
    with gathered(trial.storage):
        for step, value in enumerate(scored.instances[known:], start=known):
            trial.report(value, step)


def improvement_on_nominal(scored: ScoredTrial) -> Improvement:
    """Return the paired improvement of a trial; unknown for nominal itself and where one of the two is infeasible."""
    if scored.reference.nominal_value is None:
        return UNKNOWN_IMPROVEMENT
    return paired_improvement(stored_matrices(scored.reference.nominal_detail), score_matrices(scored.score))


def set_attributes(trial: Trial, scored: ScoredTrial, improvement: Improvement, wall_s: float) -> None:
    """Give Optuna the constraint and the headline numbers: short scalars, absent where they do not exist.

    ``improvement_percent`` is the paired improvement, positive where the trial is better than nominal.
    """
    # A trial that an earlier worker nearly finished has the constraint already; Optuna would warn of a second one.
    if COVERAGE_CONSTRAINT not in optuna_trials.known(trial).constraints:
        trial.set_constraint(COVERAGE_CONSTRAINT, scored.score.violation)
    for name, value in _attributes(scored, improvement, wall_s).items():
        trial.set_user_attr(name, value)


def _attributes(scored: ScoredTrial, improvement: Improvement, wall_s: float) -> dict[str, Any]:
    score = scored.score
    attributes: dict[str, Any] = {
        "coverage": round(score.coverage, 4),
        "noisy_runs": scored.noisy_runs,
        "wall_s": round(wall_s, 1),
    }
    if score.feasible:
        attributes["gtf_ate"] = score.value
        if math.isfinite(score.standard_error):
            attributes["gtf_se"] = score.standard_error
        if scored.decision.hopeless:
            attributes["stopped_early"] = True
        if improvement.is_known:
            attributes["improvement_percent"] = round(100 * improvement.value, 2)
    return attributes


def trial_result(scored: ScoredTrial, improvement: Improvement, wall_s: float) -> TrialResult:
    """Return the row of a trial, its matrices included."""
    score, decision = scored.score, scored.decision
    low, high = score.confidence_interval
    by_sequence = {
        name: _sequence_detail(sequence, scored.by_sequence[name]) for name, sequence in score.by_sequence.items()
    }
    return TrialResult(
        state="pruned" if decision.hopeless else "complete",
        value=score.value,
        feasible=score.feasible,
        gtf_ate=score.value if score.feasible else None,
        standard_error=_known(score.standard_error),
        ci_low=_known(low),
        ci_high=_known(high),
        coverage=score.coverage,
        collapsed_rate=_known(score.collapse_rate),
        clean_runs=sum(run.request.kind == "clean" for run in scored.runs),
        noisy_runs=sum(run.request.kind == "noisy" for run in scored.runs),
        wall_s=wall_s,
        message=score.message or (decision.reason if decision.hopeless else ""),
        detail={
            "sequences": by_sequence,
            "instances": list(scored.instances),
            "sizing": decision.reason,
            "improvement": improvement.as_json(),
        },
    )


def _sequence_detail(found: SequenceScore, runs: SequenceRuns) -> dict[str, Any]:
    detail: dict[str, Any] = {
        "value": None,
        "coverage": found.coverage,
        "coverage_nominal": min(runs.clean_coverage),
        "message": found.message,
    }
    if found.score is None:
        return detail
    score = found.score
    return detail | {
        "value": _known(score.value) if found.feasible else None,
        "standard_error": _known(score.standard_error),
        "ci": [_known(bound) for bound in score.confidence_interval],
        "matrix": [[_known(value) for value in row] for row in score.matrix.tolist()],
        "pair_errors": {f"{i},{j}": reason for (i, j), reason in score.pair_errors.items()},
        "coverage_clean": score.coverage_clean.tolist(),
        "coverage_noisy": score.coverage_noisy.tolist(),
        "collapsed": score.collapsed.tolist(),
        "extent": _known(score.extent),
    }


def _known(value: float) -> float | None:
    return value if math.isfinite(value) else None
