"""Judge candidates by runs that the search never saw: adopt one of them, or keep nominal.

A candidate may be adopted only if all of this holds:

- over the searched sequences it is better by at least 2 %, or the margin of an option that it changes, significantly so
  after correction for the number of candidates (Holm);
- on no sequence, held out or not, is it significantly worse;
- no more of its runs than of nominal's miss the coverage floor, no more pairs of runs share less than half of their
  frames, and no more noisy runs collapse, by one limit for both (`common_collapses`);
- without noise it reconstructs what nominal does (`contradiction`).

Where nominal itself falls apart or loses its frames under noise the score says little, and no candidate is adopted
(`doubt`). Of several candidates that pass the one is adopted whose 95 % interval begins highest: a larger improvement
with a wide interval is more often luck. Where nominal itself does not work there is nothing to compare with, and no
verdict.
"""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np

from gtf_tune.definition import GtfDefinition
from gtf_tune.errors import TrajectoryError
from gtf_tune.gtf import GtfScore, PairedDifference, common_collapses, difference_over_sequences, holm
from gtf_tune.gtf.random_effects import FEWEST_INSTANCES
from gtf_tune.pipelines import OptionValue
from gtf_tune.study.outcome.contradiction import CleanRun, contradictions
from gtf_tune.study.outcome.evidence import doubts_of_scores, movement
from gtf_tune.study.outcome.improvement import UNKNOWN_IMPROVEMENT, Improvement
from gtf_tune.study.outcome.verdict import (
    ADOPT,
    KEEP,
    NO_VERDICT,
    Candidate,
    MeasuredNominal,
    SequenceComparison,
    SequenceFacts,
    Verdict,
)
from gtf_tune.study.scoring.objective import LEAST_COMMON, SCORING_VERSION, CoverageFloor, below, coverage_floor

SIGNIFICANCE = 0.05

LEAST_IMPROVEMENT = 0.02
"""Share of the nominal error below which an improvement is not worth a change, however certain it is."""

NOT_BETTER = "not significantly better than nominal"
TOO_LITTLE = f"better by less than {LEAST_IMPROVEMENT:.0%}, which is not worth a change"
"""Reasons that more runs may remove; the others do not go away."""


@dataclass(frozen=True, eq=False)
class Measured:
    """One configuration with its fresh score on each sequence, and its clean runs that worked.

    ``baseline`` is its name where it is a baseline.
    """

    number: int
    options: Mapping[str, OptionValue]
    scores: Mapping[str, GtfScore]
    clean: Mapping[str, Sequence[CleanRun]] = field(default_factory=dict)
    baseline: str = ""


@dataclass(frozen=True, eq=False)
class Findings:
    """What a confirmation measured; ``nominal`` is None where there was no candidate to measure.

    ``holdouts`` are the sequences that the search did not see: they can prevent an adoption, not bring one about.
    ``margins`` are the shares of the score that some options have to win, by name.
    ``rules`` is the version of the scoring rules of the study.
    """

    nominal: Measured | None
    candidates: tuple[Measured, ...]
    holdouts: frozenset[str] = frozenset()
    rules: int = SCORING_VERSION
    margins: Mapping[str, float] = field(default_factory=dict)

    def margin(self, candidate: Measured) -> float:
        """Return the share of the score that a candidate has to win, by the options that it changes."""
        usual = self.nominal.options if self.nominal else {}
        changed = [name for name, value in candidate.options.items() if value != usual.get(name)]
        return max((self.margins.get(name, LEAST_IMPROVEMENT) for name in changed), default=LEAST_IMPROVEMENT)


@dataclass(frozen=True)
class _Compared:
    """One candidate beside nominal: over the searched sequences together, and on each sequence.

    A difference is None where nothing can be compared; ``faults`` speak against the candidate.
    """

    candidate: Measured
    together: PairedDifference | None
    by_sequence: Mapping[str, PairedDifference | None]
    faults: tuple[str, ...]
    holdouts: frozenset[str]


def judge(findings: Findings, gtf: GtfDefinition, significance: float = SIGNIFICANCE) -> Verdict:
    """Return the verdict, with each candidate's improvement, its interval, and what speaks against adopting it.

    ``significance`` is the p value below which a difference counts, at this look at the runs; intervals have the
    confidence that belongs to it, so that those of all looks together hold in 95 %.
    """
    nominal = findings.nominal
    if nominal is None:
        return Verdict(KEEP, None, (), None)
    compared = [_compare(findings, nominal, candidate, gtf, significance) for candidate in findings.candidates]
    fails = _fails(nominal, findings.holdouts)
    searched = [name for name in nominal.scores if name not in findings.holdouts]
    doubts = () if fails else doubts_of_scores(nominal.scores, searched)
    adjusted = holm([1.0 if comparison.together is None else comparison.together.p_value for comparison in compared])
    candidates = tuple(
        _candidate(
            comparison,
            [*doubts, *_reasons(comparison, p_value < significance, nominal, findings.margin(comparison.candidate))],
            p_value,
        )
        for comparison, p_value in zip(compared, adjusted, strict=True)
    )
    adopted = max(
        (candidate for candidate in candidates if candidate.passes),
        key=lambda candidate: candidate.improvement.low,
        default=None,
    )
    facts = {name: _facts(score) for name, score in nominal.scores.items()}
    return Verdict(
        word=ADOPT if adopted else NO_VERDICT if fails else KEEP,
        adopted=adopted.number if adopted else None,
        candidates=candidates,
        nominal=MeasuredNominal(nominal.number, dict(nominal.options), facts),
        doubts=doubts,
    )


def _fails(measured: Measured, holdouts: frozenset[str]) -> bool:
    """Whether a configuration works under too few noise instances on one of the searched sequences."""
    return any(count < FEWEST_INSTANCES for name, count in _working(measured).items() if name not in holdouts)


def _working(measured: Measured) -> dict[str, int]:
    """Return the number of noise instances under which a configuration has an error, by sequence."""
    return {name: int((~np.isnan(score.matrix)).any(axis=0).sum()) for name, score in measured.scores.items()}


def _compare(
    findings: Findings, nominal: Measured, candidate: Measured, gtf: GtfDefinition, significance: float
) -> _Compared:
    holdouts = findings.holdouts
    searched = [name for name in nominal.scores if name not in holdouts]
    pairs = {name: (score, candidate.scores[name]) for name, score in nominal.scores.items()}
    by_sequence = {name: _difference([pair], significance) for name, pair in pairs.items()}
    together = _difference([pairs[name] for name in searched], significance)
    faults = []
    for name, (of_nominal, of_candidate) in pairs.items():
        found = _lost_frames(name, of_nominal, of_candidate, gtf.coverage_floor, findings.rules)
        faults += [*found, *_faults(name, of_nominal, of_candidate, lost=bool(found))]
    faults += [
        f"on {name} it {fault}" for name in nominal.scores for fault in _contradictions(name, nominal, candidate)
    ]
    worse = [name for name, found in by_sequence.items() if found is not None and _is_worse(found, significance)]
    faults += [f"worse on {name}" for name in worse]
    return _Compared(candidate, together, by_sequence, tuple(faults), holdouts)


def _contradictions(name: str, nominal: Measured, candidate: Measured) -> tuple[str, ...]:
    moved = [movement(measured.scores[name]) for measured in (nominal, candidate)]
    return contradictions(nominal.clean.get(name, ()), candidate.clean.get(name, ()), sum(one or 0.0 for one in moved))


def _difference(pairs: Sequence[tuple[GtfScore, GtfScore]], significance: float) -> PairedDifference | None:
    try:
        return difference_over_sequences(pairs, 1 - significance)
    except TrajectoryError:
        return None


def _is_worse(found: PairedDifference, significance: float) -> bool:
    return found.ratio > 1 and found.p_value < significance


def _faults(name: str, nominal: GtfScore, candidate: GtfScore, *, lost: bool) -> list[str]:
    """Return what speaks against a candidate on one sequence besides ``lost`` frames."""
    found = []
    apart = [int((score.common_shares < LEAST_COMMON).sum()) for score in (nominal, candidate)]
    if apart[1] > apart[0] and not lost:
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


def _lost_frames(name: str, nominal: GtfScore, candidate: GtfScore, share: float, rules: int) -> list[str]:
    """Return the worst run where more runs of the candidate than of nominal miss the floor that nominal sets."""
    clean, noisy = nominal.coverage_clean.tolist(), nominal.coverage_noisy.tolist()
    floor = coverage_floor(clean, noisy, share, rules)
    missing = [_missing(score, floor) for score in (nominal, candidate)]
    if sum(gap > 0 for gap, _, _ in missing[1]) <= sum(gap > 0 for gap, _, _ in missing[0]):
        return []
    _, *both = max(missing[1])
    shown, wanted = below(*both)
    return [f"a run on {name} registered {shown} of the frames, less than {wanted}"]


def _missing(score: GtfScore, floor: CoverageFloor) -> list[tuple[float, float, float]]:
    """Return for every run how much it lacks, its coverage, and its floor."""
    runs = [
        *((coverage, floor.clean) for coverage in score.coverage_clean.tolist()),
        *((coverage, floor.noisy) for coverage in score.coverage_noisy.tolist()),
    ]
    return [(wanted - coverage, coverage, wanted) for coverage, wanted in runs]


def _candidate(compared: _Compared, reasons: Sequence[str], adjusted: float) -> Candidate:
    return Candidate(
        number=compared.candidate.number,
        options=dict(compared.candidate.options),
        value=_value(compared),
        improvement=_improvement(compared.together),
        p_value=_p_value(compared.together),
        adjusted_p_value=float(adjusted),
        passes=not reasons,
        reasons=tuple(reasons),
        baseline=compared.candidate.baseline,
        by_sequence={
            name: SequenceComparison(
                _facts(compared.candidate.scores[name]), _improvement(found), _p_value(found), name in compared.holdouts
            )
            for name, found in compared.by_sequence.items()
        },
    )


def _reasons(compared: _Compared, is_significant: bool, nominal: Measured, margin: float) -> list[str]:
    """Return all that speaks against a candidate, which has to win the ``margin``."""
    reasons = list(compared.faults)
    if compared.together is None and _fails(nominal, compared.holdouts):
        name, count = min(_working(nominal).items(), key=lambda item: (item[0] in compared.holdouts, item[1]))
        of_all = f"{count} of {len(nominal.scores[name].coverage_noisy)} noisy runs on {name}"
        reasons.append(f"cannot be compared with nominal, which worked in {of_all}")
    elif compared.together is None:
        reasons.append("cannot be compared with nominal: too few runs worked under both")
    elif compared.together.ratio >= 1 or not is_significant:
        reasons.append(NOT_BETTER)
    elif compared.together.ratio > 1 - LEAST_IMPROVEMENT:
        reasons.append(TOO_LITTLE)
    elif compared.together.ratio > 1 - margin:
        reasons.append(f"better by less than {margin:.0%}, which options before the mapper have to win")
    return reasons


def _value(compared: _Compared) -> float:
    """Return the candidate's score: of the only sequence, or over sequences relative to nominal."""
    scores = list(compared.candidate.scores.values())
    if len(scores) == 1:
        return scores[0].value
    return compared.together.ratio if compared.together else math.nan


def _improvement(found: PairedDifference | None) -> Improvement:
    if found is None:
        return UNKNOWN_IMPROVEMENT
    return Improvement(1 - found.ratio, 1 - found.high, 1 - found.low, found.n)


def _p_value(found: PairedDifference | None) -> float:
    return math.nan if found is None else found.p_value


def _facts(score: GtfScore) -> SequenceFacts:
    coverage = float(min(score.coverage_clean.min(), score.coverage_noisy.min()))
    return SequenceFacts(score.value, coverage, int(score.collapsed.sum()))
