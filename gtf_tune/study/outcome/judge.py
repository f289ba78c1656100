"""Judge candidates by runs that the search never saw: adopt one, or keep nominal.

A candidate is adopted only if all of this holds: it is better over the searched sequences, significantly so after
correction for the number of candidates (Holm), and by 2 % at the least; no sequence, held out or not, is significantly
worse; no more runs than under nominal miss the coverage floor; no more pairs of runs share less than half of their
frames; no more noisy runs collapse, by one limit for both (`common_collapses`). Where nominal itself does not work
there is nothing to compare with, and no verdict. Of several such candidates the one is adopted whose improvement is
surest: its 95 % interval begins highest. A larger improvement with a wide interval is more often luck, and runs that
scatter more are what nobody wants.
"""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from gtf_tune.definition import GtfDefinition
from gtf_tune.errors import TrajectoryError
from gtf_tune.gtf import GtfScore, PairedDifference, common_collapses, difference_over_sequences, holm
from gtf_tune.gtf.random_effects import FEWEST_INSTANCES
from gtf_tune.pipelines import OptionValue
from gtf_tune.study.outcome.verdicts import ADOPT, KEEP, NO_VERDICT
from gtf_tune.study.scoring.coverage import LEAST_COMMON, CoverageFloor, below, coverage_floor

SIGNIFICANCE = 0.05

LEAST_IMPROVEMENT = 0.02
"""Share of the nominal error below which a change of settings is not worth it, however certain."""


@dataclass(frozen=True, eq=False)
class Measured:
    """Hold one setting with its fresh score on each sequence."""

    number: int
    options: Mapping[str, OptionValue]
    scores: Mapping[str, GtfScore]


@dataclass(frozen=True, eq=False)
class Findings:
    """Hold what a confirmation measured; ``nominal`` is None where there was no candidate to measure.

    ``holdouts`` are the sequences that the search did not see: they can prevent an adoption, not earn it.
    """

    nominal: Measured | None
    candidates: tuple[Measured, ...]
    holdouts: frozenset[str] = frozenset()


@dataclass(frozen=True)
class _Compared:
    """Hold one candidate beside nominal: over the searched sequences together, and on each sequence.

    A difference is None where it cannot be told; ``faults`` say what speaks against the candidate.
    """

    candidate: Measured
    together: PairedDifference | None
    by_sequence: Mapping[str, PairedDifference | None]
    faults: tuple[str, ...]


def judge(findings: Findings, gtf: GtfDefinition) -> dict[str, Any]:
    """Return the verdict with each candidate's improvement, its interval, and the reasons, as stored and printed."""
    nominal = findings.nominal
    if nominal is None:
        return {"verdict": KEEP, "adopted": None, "candidates": [], "nominal": None}
    compared = [_compare(nominal, one, findings.holdouts, gtf) for one in findings.candidates]
    adjusted = holm([1.0 if one.together is None else one.together.p_value for one in compared])
    rows = [_row(one, float(p), nominal, findings.holdouts) for one, p in zip(compared, adjusted, strict=True)]
    adopted = max((row for row in rows if row["verdict"] == ADOPT), key=lambda row: row["low"], default=None)
    return {
        "verdict": ADOPT if adopted else NO_VERDICT if _fails(nominal, findings.holdouts) else KEEP,
        "adopted": adopted["ordinal"] if adopted else None,
        "candidates": rows,
        "nominal": {
            "ordinal": nominal.number,
            "options": dict(nominal.options),
            "by_sequence": {name: _facts(score) for name, score in nominal.scores.items()},
        },
    }


def _fails(measured: Measured, holdouts: frozenset[str]) -> bool:
    """Tell whether a setting works under too few noise instances on one of the searched sequences."""
    return any(count < FEWEST_INSTANCES for name, count in _working(measured).items() if name not in holdouts)


def _working(measured: Measured) -> dict[str, int]:
    """Return under how many noise instances a setting has an error, by sequence."""
    return {name: int((~np.isnan(score.matrix)).any(axis=0).sum()) for name, score in measured.scores.items()}


def _compare(nominal: Measured, candidate: Measured, holdouts: frozenset[str], gtf: GtfDefinition) -> _Compared:
    searched = [name for name in nominal.scores if name not in holdouts]
    pairs = {name: (score, candidate.scores[name]) for name, score in nominal.scores.items()}
    by_sequence = {name: _difference([pair]) for name, pair in pairs.items()}
    together = _difference([pairs[name] for name in searched])
    faults = [
        fault for name in nominal.scores for fault in _faults(name, nominal.scores[name], candidate.scores[name], gtf)
    ]
    faults += [f"worse on {name}" for name, found in by_sequence.items() if found is not None and _is_worse(found)]
    return _Compared(candidate, together, by_sequence, tuple(faults))


def _difference(pairs: Sequence[tuple[GtfScore, GtfScore]]) -> PairedDifference | None:
    try:
        return difference_over_sequences(pairs)
    except TrajectoryError:
        return None


def _is_worse(found: PairedDifference) -> bool:
    return found.ratio > 1 and found.p_value < SIGNIFICANCE


def _faults(name: str, nominal: GtfScore, candidate: GtfScore, gtf: GtfDefinition) -> list[str]:
    found = _lost_frames(name, nominal, candidate, gtf)
    apart = [int((one.common_shares < LEAST_COMMON).sum()) for one in (nominal, candidate)]
    if apart[1] > apart[0] and not found:
        shown, wanted = below(float(candidate.common_shares.min()), LEAST_COMMON)
        found.append(f"a noisy run on {name} shares {shown} of its frames with a clean one, less than {wanted}")
    of_nominal, of_candidate = common_collapses(nominal.matrix, candidate.matrix)
    if of_candidate.sum() > of_nominal.sum():
        found.append(
            f"{int(of_candidate.sum())} of {of_candidate.size} noisy runs on {name} collapsed, "
            f"{int(of_nominal.sum())} under nominal"
        )
    new_errors = [reason for pair, reason in candidate.pair_errors.items() if pair not in nominal.pair_errors]
    if len(candidate.pair_errors) > len(nominal.pair_errors):
        found.append(f"runs on {name} cannot be compared: {new_errors[0]}")
    return found


def _lost_frames(name: str, nominal: GtfScore, candidate: GtfScore, gtf: GtfDefinition) -> list[str]:
    """Return what is wrong where more runs of the candidate than of nominal miss the floor that nominal sets."""
    clean, noisy = nominal.coverage_clean.tolist(), nominal.coverage_noisy.tolist()
    floor = coverage_floor(clean, noisy, gtf.coverage_floor)
    missing = [_missing(one, floor) for one in (nominal, candidate)]
    if sum(gap > 0 for gap, _, _ in missing[1]) <= sum(gap > 0 for gap, _, _ in missing[0]):
        return []
    _, *both = max(missing[1])
    shown, wanted = below(*both)
    return [f"a run on {name} registered {shown} of the frames, less than {wanted}"]


def _missing(score: GtfScore, floor: CoverageFloor) -> list[tuple[float, float, float]]:
    """Return for every run how much it lacks, its coverage, and its floor."""
    runs = [
        *((one, floor.clean) for one in score.coverage_clean.tolist()),
        *((one, floor.noisy) for one in score.coverage_noisy.tolist()),
    ]
    return [(wanted - coverage, coverage, wanted) for coverage, wanted in runs]


def _row(one: _Compared, adjusted: float, nominal: Measured, holdouts: frozenset[str]) -> dict[str, Any]:
    reasons = list(one.faults)
    if one.together is None and _fails(nominal, holdouts):
        name, count = min(_working(nominal).items(), key=lambda item: (item[0] in holdouts, item[1]))
        of_all = f"{count} of {len(nominal.scores[name].coverage_noisy)} noisy runs on {name}"
        reasons.append(f"cannot be compared with nominal, which worked in {of_all}")
    elif one.together is None:
        reasons.append("cannot be compared with nominal: too few runs worked under both")
    elif one.together.ratio >= 1 or adjusted >= SIGNIFICANCE:
        reasons.append("not significantly better than nominal")
    elif one.together.ratio > 1 - LEAST_IMPROVEMENT:
        reasons.append(f"better by less than {LEAST_IMPROVEMENT:.0%}, which is not worth a change")
    return {
        "ordinal": one.candidate.number,
        "options": dict(one.candidate.options),
        **_improvement(one.together),
        "adjusted_p_value": adjusted,
        "verdict": KEEP if reasons else ADOPT,
        "reasons": reasons,
        "by_sequence": {
            name: {**_facts(score), **_improvement(one.by_sequence[name]), "holdout": name in holdouts}
            for name, score in one.candidate.scores.items()
        },
        "value": _relative(one, nominal),
    }


def _relative(one: _Compared, nominal: Measured) -> float | None:
    """Return the candidate's score: of the only sequence, or over sequences relative to nominal."""
    scores = one.candidate.scores
    if len(nominal.scores) == 1:
        return _known(next(iter(scores.values())).value)
    return _known(one.together.ratio) if one.together else None


def _improvement(found: PairedDifference | None) -> dict[str, float | int | None]:
    if found is None:
        return {"improvement": None, "low": None, "high": None, "p_value": None, "instances": 0}
    return {
        "improvement": 1 - found.ratio,
        "low": 1 - found.high,
        "high": 1 - found.low,
        "p_value": found.p_value,
        "instances": found.n,
    }


def _facts(score: GtfScore) -> dict[str, Any]:
    return {"value": _known(score.value), "coverage": _least_coverage(score), "collapsed": int(score.collapsed.sum())}


def _least_coverage(score: GtfScore) -> float:
    return float(min(score.coverage_clean.min(), score.coverage_noisy.min()))


def _known(value: float) -> float | None:
    return value if math.isfinite(value) else None
